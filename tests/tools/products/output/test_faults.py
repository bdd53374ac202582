"""Warnings about uncertain pairs, transforms of ties, and the table of input files."""

import hashlib
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.slam.mapper import Mapper
from sonarmap.slam.pair import Pair
from sonarmap.slam.survey_result import SurveyResult
from sonarmap.slam.tie import Tie
from sonarmap.spectral.result import Registration
from sonarmap.spectral.scan import PosePrior
from sonarmap.tools.files.readers.constraints import POSE, SIGMAS, read_ties
from sonarmap.tools.files.user_file import input_rows
from sonarmap.tools.products.output.faults import faults
from sonarmap.tools.products.output.pairs_file import tie_rows
from tests.samples.surveys import KnowingRegistrar, ring_poses, scans_of

COUNT = 10
NAMES = [f"scan{k}" for k in range(COUNT)]


@cache
def survey() -> SurveyResult:
    truth = ring_poses(COUNT, turns=0.3)
    return Mapper(KnowingRegistrar(truth, 1e-6 * np.eye(6)), 0.5).run(scans_of(truth))


@pytest.mark.parametrize(
    ("probability", "across", "warned"),
    [(0.75, "refused", True), (0.75, "kept", False), (0.93, "refused", True), (0.93, "kept", False)],
)
def test_uncertain_steps_are_named_if_one_of_them_may_well_be_wrong(
    probability: float, across: str, warned: bool
) -> None:
    """As between two dives over beds of little relief in one folder."""
    result = survey()

    def changed(pair: Pair) -> Pair:
        assert pair.registration is not None
        if pair.scans == (4, 5):
            return replace(pair, registration=replace(pair.registration, probability=probability))
        if pair.i > 4 or pair.j < 5 or across == "kept":
            return pair
        return replace(pair, registration=replace(pair.registration, accepted=False), edge=None)

    pairs = tuple(changed(pair) for pair in result.pairs)
    sentences = [fault for fault in faults(replace(result, pairs=pairs), NAMES) if "are uncertain" in fault]
    assert len(sentences) == warned
    if warned:
        assert sentences[0].startswith(
            "1 of 9 steps between consecutive scans, as between scan4 and scan5, are uncertain: all are right with a "
            f"probability of {probability:.0%}"
        )
    sigmas = np.array([np.inf, np.inf, np.inf, 0.5, 0.5, np.inf])
    priors = tuple((k, PosePrior(RigidTransform.identity(), sigmas)) for k in (4, 5))
    located = replace(result.solution, graph=replace(result.solution.graph, priors=priors))
    sentences = faults(replace(result, pairs=pairs, solution=located), NAMES)
    assert not any("are uncertain" in sentence for sentence in sentences)


def test_the_transform_of_a_tie_is_written_and_read_unchanged(tmp_path: Path) -> None:
    """Through summary.json and a file of ties."""
    R = Rotation.from_euler("ZYX", [40.0, -7.0, 3.0], degrees=True)
    T = RigidTransform.from_components([1.5, -2.25, 0.75], R)
    covariance = np.diag(np.repeat([np.radians(0.5), 0.02], 3) ** 2)
    given = Registration(T, covariance, np.nan, np.nan, True, 0.0, "by hand")
    (row,) = tie_rows(replace(survey(), ties=(Tie(2, 7, "add", given),)), NAMES)
    assert [row[name] for name in (*POSE, *SIGMAS)] == pytest.approx([1.5, -2.25, 0.75, 3, -7, 40, 0.02, 0.5])
    columns = ["target", "source", "verdict", *POSE, *SIGMAS]
    file = tmp_path / "ties.csv"
    file.write_text(",".join(columns) + "\n" + ",".join(str(row[name]) for name in columns) + "\n")
    scans = [replace(scan, name=name) for scan, name in zip(scans_of(ring_poses(COUNT)), NAMES, strict=True)]
    (tie,) = read_ties(file, scans)
    assert tie.given is not None
    assert np.allclose(tie.given.T_target_source.as_matrix(), T.as_matrix(), atol=1e-12)
    assert np.allclose(tie.given.covariance, covariance, rtol=1e-9)


def test_input_names_start_at_the_common_folder_and_folders_list_their_files(tmp_path: Path) -> None:
    contents = {"dives/a/scan.ply": b"one", "dives/b/scan.ply": b"two", "bag/part.db3": b"three", "nav.csv": b""}
    for name, content in contents.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_bytes(content)
    paths = [tmp_path / "dives/a/scan.ply", tmp_path / "dives/b/scan.ply", tmp_path / "bag", tmp_path / "nav.csv"]
    assert input_rows([*paths, paths[0]]) == [
        {"name": name, "bytes": len(content), "sha256": hashlib.sha256(content).hexdigest()}
        for name, content in contents.items()
    ]
    assert [row["name"] for row in input_rows(paths[:1])] == ["scan.ply"]
    # a file that cannot be read is listed all the same
    assert input_rows([tmp_path / "gone.ply"]) == [{"name": "gone.ply", "bytes": None, "sha256": None}]
    assert input_rows([]) == []
