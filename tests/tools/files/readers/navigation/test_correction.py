"""Corrections of measured poses: parsing, application, composition, and what each mistake is corrected by."""

import numpy as np
import pytest

from sonarmap.spectral.scan import Scan
from sonarmap.tools.files.readers.instruments import COLUMNS, prior_of, sigmas_of, values_of
from sonarmap.tools.files.readers.navigation.contradictions import Contradiction, corrected
from sonarmap.tools.files.readers.navigation.correction import Correction
from sonarmap.tools.files.readers.navigation.priors import navigate
from sonarmap.tools.files.readers.navigation.settings import NavigationSettings
from tests.samples.refusals import refuses

VALUES = np.array([[3.0, -2.0, 70.0, 10.0, 20.0, 5.0], [np.nan, np.nan, 350.0, 1.5, -4.0, np.nan]])
SIGMAS = np.array([0.5, 0.6, 2.0, 1.0, 1.1, 0.1])


@pytest.mark.parametrize(
    ("text", "column", "wanted"),
    [
        ("heading_deg=-heading_deg", 2, (-70, -350)),
        ("heading_deg=90-heading_deg", 2, (20, -260)),
        ("heading_deg = -25.5 + heading_deg", 2, (44.5, 324.5)),
        ("x_m=0.3048*x_m", 3, (3.048, 0.4572)),
        ("depth_m=1.5-.5*depth_m", 5, (-1, np.nan)),
        ("roll_deg=pitch_deg,pitch_deg=roll_deg", 0, (-2, np.nan)),
        ("x_m=y_m,y_m=-2*x_m", 4, (-20, -3)),
    ],
)
def test_a_correction_sets_the_columns_that_it_names(text: str, column: int, wanted: tuple[float, float]) -> None:
    correction = Correction.of(text)
    changed = correction(VALUES)
    np.testing.assert_allclose(changed[:, column], wanted)
    others = [k for k, name in enumerate(COLUMNS) if f"{name}=" not in text.replace(" ", "")]
    np.testing.assert_array_equal(changed[:, others], VALUES[:, others])
    np.testing.assert_allclose(Correction.of(str(correction))(VALUES), changed)


@pytest.mark.parametrize(
    "text", ["", "heading_deg", "heading=-heading", "x_m=2x_m", "x_m=nan*x_m", "x_m=x_m*2", "x_m=1+2+x_m", "x_m=5"]
)
def test_other_texts_are_refused(text: str) -> None:
    refuses("--correct-priors is .*; wanted corrections as", Correction.of, text)


@pytest.mark.parametrize("seed", range(3))
def test_corrections_after_each_other_are_one(seed: int) -> None:
    rng = np.random.default_rng(seed)
    one, two = (
        Correction(rng.permutation(6), rng.choice([-1.0, 1.0, 0.3048], 6), rng.choice([0.0, 90.0, -25.5], 6))
        for _ in range(2)
    )
    both = two.after(one)
    np.testing.assert_allclose(both(VALUES), two(one(VALUES)))
    np.testing.assert_allclose(Correction.of(str(both))(VALUES), two(one(VALUES)), rtol=1e-6)


def test_a_prior_keeps_its_standard_deviations_by_column() -> None:
    prior = prior_of(np.array([np.nan, np.nan, 70.0, 10.0, 20.0, np.nan]), SIGMAS)
    changed = Correction.of("heading_deg=-heading_deg,x_m=y_m,y_m=x_m,depth_m=0.5*x_m").of_prior(prior)
    np.testing.assert_allclose(values_of(changed.T_world_sensor)[2:], [290, 20, 10, 5])
    np.testing.assert_allclose(sigmas_of(changed), [np.inf, np.inf, 2, 1, 1.1, 0.5])


def test_navigation_is_corrected_when_it_is_read(tmp_path) -> None:
    log = tmp_path / "log.csv"
    log.write_text("name,heading_deg,depth_m\na,70,5\nb,80,6\n")
    scans = [Scan(np.ones((3, 3), np.float32), stamp=float(k), name=name) for k, name in enumerate("ab")]
    settings = NavigationSettings(
        sigmas={"heading_deg": 2.0, "depth_m": 0.1}, correction=Correction.of("heading_deg=-heading_deg")
    )
    read = navigate(scans, log, settings).scans
    assert [values_of(scan.prior.T_world_sensor)[2] for scan in read if scan.prior] == pytest.approx([290, 280])


def test_each_mistake_has_the_option_that_corrects_it() -> None:
    """What a message says, given to the option, corrects the values as the hypothesis did."""
    rng = np.random.default_rng(1)
    values = rng.uniform(1, 80, (9, 6))
    by_option = 0
    for name, changed in corrected(values):
        for remedy in Contradiction(9.0, (name,)).remedies(0.5):
            if not isinstance(remedy, str) and remedy.option == "correct_priors":
                np.testing.assert_allclose(Correction.of(remedy.values[0])(values), changed, err_msg=name, rtol=1e-8)
                by_option += 1
    assert by_option == 19
    (turned,) = Contradiction(9.0, ("heading_deg turned by -25 degrees",)).remedies(0.5)
    assert str(turned) == "--correct-priors heading_deg=-25+heading_deg"


@pytest.mark.parametrize(("name", "offset"), [("the rows 3 scans before", -1.5), ("the rows of the scans after", 0.5)])
def test_shifted_rows_name_the_offset_of_the_log(name: str, offset: float) -> None:
    (remedy,) = Contradiction(9.0, (name,)).remedies(0.5)
    assert str(remedy) == f"--nav-offset {offset}"


def test_axes_of_other_scans_are_named() -> None:
    mirrored = Contradiction(9.0, ("scans mirrored, left for right",))
    assert [str(each) for each in mirrored.remedies(1.0)] == ["--frame fru"]
    assert [str(each) for each in mirrored.remedies(1.0, "rdf")] == ["--frame ldf"]
    upside_down = Contradiction(9.0, ("scans upside down",)).remedies(1.0, "frd")
    assert [str(each) for each in upside_down] == ["--frame flu", "--correct-priors roll_deg=180+roll_deg"]
