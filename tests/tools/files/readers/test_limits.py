"""Numbers beyond any use, in every file of poses and of settings: an error that names the file, no warning, no NaN."""

import re
from pathlib import Path

import numpy as np
import pytest

from sonarmap.kernels.errors import InputError
from sonarmap.tools.command.navigation import parse_prior_sigmas
from sonarmap.tools.files.readers.json_file import read_json
from tests.samples.cloud_files import put
from tests.samples.clutter_scans import refused_with_reason, said, sonarmap
from tests.samples.damage.pose_files import POSE_FILES, numbers_in

pytestmark = pytest.mark.filterwarnings("error")
HOSTILE = (b"1e308", b"-1e308", b"1e200", b"-1e35", b"1e999", b"1" + b"0" * 400, b"nan", b"-inf")
TINY = (b"1e-308", b"1e-200", b"0", b"-1")
NUMBER = re.compile(rb"(?<![\w.:-])-?\d+(\.\d+)?(?![\w.])")


@pytest.mark.parametrize("kind", POSE_FILES)
def test_every_number_has_a_largest(tmp_path: Path, kind: str) -> None:
    file = POSE_FILES[kind]
    path = tmp_path / file.name
    for number in NUMBER.finditer(file.content):
        for hostile in HOSTILE:
            put(path, file.content[: number.start()] + hostile + file.content[number.end() :])
            with pytest.raises(InputError, match=re.escape(str(path))):
                file.read(path)


@pytest.mark.parametrize("kind", POSE_FILES)
def test_what_is_next_to_nothing_gives_no_infinity(tmp_path: Path, kind: str) -> None:
    file = POSE_FILES[kind]
    path = tmp_path / file.name
    assert all(np.isfinite(numbers).all() for numbers in numbers_in(file.read(put(path, file.content))))
    for number in NUMBER.finditer(file.content):
        for tiny in TINY:
            put(path, file.content[: number.start()] + tiny + file.content[number.end() :])
            try:
                result = file.read(path)
            except InputError:
                continue
            assert all(np.isfinite(numbers).all() for numbers in numbers_in(result)), (tiny, number)


@pytest.mark.parametrize("alignment", ["poses", "positions", "first"])
def test_an_evaluation_of_such_numbers_ends(tmp_path: Path, alignment: str) -> None:
    """With 1e200 it did not; the largest allowed can be computed with."""
    truth = put(tmp_path / "truth.tum", POSE_FILES["tum"].content)
    estimate = put(tmp_path / "estimate.tum", truth.read_bytes().replace(b"2.25", b"1e200", 1))
    result = sonarmap("evaluate", estimate, truth, "--align", alignment)
    refused_with_reason(result)
    said(result, f"error: {estimate}: line 1 holds 1e+200; wanted ty within 1e+09: fix that line")
    if alignment != "positions":
        put(estimate, truth.read_bytes().replace(b"2.25", b"1e9", 1))
        result = sonarmap("evaluate", estimate, truth, "--align", alignment, "--json")
        assert result.exit_code == 0
        assert "NaN" not in result.stdout


@pytest.mark.parametrize("options", [[], ["--repair"], ["--robust"]])
@pytest.mark.parametrize(("given", "hostile"), [(b" 100 ", b" 1e308 "), (b" 1.5 ", b" 1e200 "), (b" 0.5 ", b" -1e29 ")])
def test_a_graph_of_such_numbers_is_refused(tmp_path: Path, given: bytes, hostile: bytes, options: list[str]) -> None:
    path = put(tmp_path / "in.g2o", POSE_FILES["g2o"].content.replace(given, hostile, 1))
    result = sonarmap("optimize", path, "-o", tmp_path / "out.g2o", *options)
    if (hostile, options) == (b" -1e29 ", ["--repair"]):
        assert "nan" not in (tmp_path / "out.g2o").read_text()
    else:
        refused_with_reason(result)
        said(result, f"error: {path}: line ")
        assert not (tmp_path / "out.g2o").exists()


@pytest.mark.filterwarnings("default")
@pytest.mark.parametrize("number", [b"1e16", b"9223372036854775808", b"1e30"])
@pytest.mark.parametrize("options", [[], ["--repair"]])
def test_weights_that_differ_too_much_to_be_added_are_an_error(
    tmp_path: Path, number: bytes, options: list[str]
) -> None:
    edge = b"EDGE_SE3:QUAT 1 2 1.5 0.25 0 0 0 0 1 100 0.5 0.5 0.5 0.5 0.5 "
    before, _, after = POSE_FILES["g2o"].content.rpartition(edge + b"100 ")
    path = put(tmp_path / "in.g2o", before + edge + number + b" " + after)
    result = sonarmap("optimize", path, "-o", tmp_path / "out.g2o", *options)
    refused_with_reason(result)
    said(result, "error: the pose graph of 3 poses and 2 edges has no unique solution")


def test_a_covariance_of_nothing_is_an_error(tmp_path: Path) -> None:
    summary = put(tmp_path / "summary.json", POSE_FILES["summary.json"].content.replace(b"0.125", b"0"))
    put(tmp_path / "pairs.csv", POSE_FILES["pairs.csv"].content)
    poses = put(tmp_path / "poses.tum", POSE_FILES["tum"].content)
    result = sonarmap("evaluate", poses, poses, "--summary", summary)
    refused_with_reason(result)
    said(result, "error: a pose's covariance is singular")


@pytest.mark.parametrize("text", ["1e308,1,1,1", "1,1e-200,1,1", "1,1,inf,1"])
def test_options_have_the_same_limits(text: str) -> None:
    with pytest.raises(InputError):
        parse_prior_sigmas(text)


class TestNesting:
    @pytest.mark.parametrize("kind", [kind for kind in POSE_FILES if kind.endswith(".json")])
    @pytest.mark.parametrize("content", [b"[" * 100_000, b'{"a":' * 100_000, b"[" * 500 + b"]" * 500])
    def test_it_is_an_error_in_words(self, tmp_path: Path, kind: str, content: bytes) -> None:
        path = put(tmp_path / "deep.json", content)
        with pytest.raises(InputError, match=re.escape(str(path))):
            POSE_FILES[kind].read(path)

    def test_the_command_line_says_so(self, tmp_path: Path) -> None:
        path = put(tmp_path / "deep.json", b"[" * 100_000)
        result = sonarmap("simulate", "--like", path, "-o", tmp_path / "out")
        refused_with_reason(result)
        said(result, f"error: cannot read {path}: it is nested too deeply; expected the description.json")
        assert not (tmp_path / "out").exists()

    def test_what_is_right_is_read(self, tmp_path: Path) -> None:
        path = put(tmp_path / "a.json", b'{"a": [1, -2.5e-3, 9223372036854775807, 1e30, null, "\xc3\xb6"]}')
        assert read_json(path, "a file") == {"a": [1, -2.5e-3, 2**63 - 1, 1e30, None, "ö"]}
