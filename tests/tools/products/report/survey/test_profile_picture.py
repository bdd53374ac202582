"""The profile along the track: its numbers by hand, and how they are drawn."""

import numpy as np
import pytest
from matplotlib.figure import Figure
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.slam.graph.trajectory import Trajectory
from sonarmap.tools.products.report.profile_picture import profile_figure
from sonarmap.tools.products.report.survey.profile import heights_under, profile_of, world_sigmas
from sonarmap.tools.products.report.survey.view import PartView
from tests.tools.products.report.survey.known_view import SEA, bed, overlapping_texts, pair, track, view_of

PAIRS = (*(pair(k, k + 1, kept=k != 2, accepted=k != 2) for k in range(9)), pair(1, 7, "loop"))
TWO = {"surveys": (0,) * 4 + (1,) * 6, "survey_names": {0: "survey 0 (a)", 1: "survey 1 (b)"}}
HERE = 1.7e9  # a day in 2023 [s]


def panels_of(figure: Figure) -> dict[str, np.ndarray]:
    """The lines of the panels by their labels."""
    return {
        str(line.get_label()): np.array(line.get_xydata())
        for axes in figure.axes
        for line in axes.lines
        if not str(line.get_label()).startswith("_")
    }


class TestNumbers:
    def test_sigmas_are_in_the_world(self) -> None:
        """A sensor turned by 90 degrees about x (y to z, z to -y): its y is the world's up."""
        R = Rotation.from_euler("x", 90, degrees=True).as_matrix()
        covariance = np.diag([0.01, 0.04, 0.09, 1.0, 4.0, 9.0])
        horizontal, vertical, heading = world_sigmas(R[None], covariance[None])[:, 0]
        assert (horizontal, vertical) == pytest.approx((3.0, 2.0))
        assert heading == pytest.approx(np.degrees(0.2))
        covariance = np.zeros((6, 6))  # the worst horizontal direction counts
        covariance[3:5, 3:5] = [[5.0, 4.0], [4.0, 5.0]]  # eigenvalues 9 and 1
        assert world_sigmas(np.eye(3)[None], covariance[None])[:, 0] == pytest.approx([3.0, 0.0, 0.0])

    def test_points_under_a_place(self) -> None:
        """Within 2 m of (10, 20) along both axes, and below 0: heights -8 to -4; the others are beside or above."""
        under = [[10 + x, 20 + y, z] for x, y, z in ((0, 0, -4), (1.9, 0, -5), (0, -1.9, -6), (-1, 1, -7), (1, 1, -8))]
        beside = [[12.1, 20, -50], [10, 17.9, -50], [10, 20, 3]]
        places = np.array([[10.0, 20.0, 0.0], [100.0, 20.0, 0.0]])
        heights = heights_under(np.array(under + beside), places, 2.0)
        assert heights[:, 0] == pytest.approx([-7.6, -6.0, -4.4])
        assert np.isnan(heights[:, 1]).all()

    def test_depths_and_distances_along_the_diagonal(self) -> None:
        """Scans from (0, 0) to (90, 60), 9 steps; 5 m below the frame's origin, the zero of depths 2 m above it."""
        profile = profile_of(view_of(bed(91, 61), track(90, 60, 10), PAIRS, frame=SEA))
        assert profile.axis == "distance along the track [m]"
        assert profile.along == pytest.approx(np.arange(10) * np.hypot(10, 20 / 3))
        assert profile.vehicle == pytest.approx([7.0] * 10)
        assert profile.bed[1] == pytest.approx(32 - 20 * np.arange(10) * 10 / 91, abs=0.4)
        assert (np.diff(profile.bed, axis=0) <= 0).all()  # the deepest first
        assert profile.overlaps[:, 0] == pytest.approx((np.arange(9) + 0.5) * np.hypot(10, 20 / 3))
        assert profile.overlaps[:, 1] == pytest.approx(0.5 + np.arange(9) / 1000)
        assert profile.kept.tolist() == [True, True, False] + 6 * [True]
        assert profile.loop_ends == (1, 7)
        assert profile.sigmas[:, 4] == pytest.approx([0.2, 0.3, np.degrees(0.02)])
        profile = profile_of(view_of(bed(91, 61), track(90, 60, 10), PAIRS, **TWO))
        assert profile.starts == (4,)  # between surveys there is no track
        assert profile.along[3] == profile.along[4] == pytest.approx(3 * np.hypot(10, 20 / 3))

    @pytest.mark.parametrize(
        ("stamps", "axis", "last"),
        [
            (np.arange(10.0), "number of the scan", 9),
            (HERE + np.arange(10.0), "time since the first scan [s]", 9),
            (HERE + 60 * np.arange(10.0), "time since the first scan [min]", 9),
            (HERE + 1800 * np.arange(10.0), "time since the first scan [h]", 4.5),
            (HERE - np.arange(10.0), "number of the scan", 9),
        ],
    )
    def test_a_sensor_that_hardly_moves_has_times_or_numbers(self, stamps: np.ndarray, axis: str, last: float) -> None:
        poses = Trajectory(stamps, RigidTransform.from_components(track(0.1, 0.1, 10), Rotation.identity(10)))
        profile = profile_of(view_of(bed(20, 10), track(0.1, 0.1, 10), trajectory=poses))
        assert (profile.axis, profile.along[-1]) == (axis, pytest.approx(last))


@pytest.mark.quick_cases(3)
@pytest.mark.parametrize(
    "view",
    [
        view_of(bed(91, 61), track(90, 60, 10), PAIRS),
        view_of(bed(91, 61), track(90, 60, 10), PAIRS, **TWO, frame=SEA),
        view_of(bed(91, 61), track(90, 60, 600), tuple(pair(k, k + 1) for k in range(599)), frame=SEA),
        view_of(bed(9, 6), track(9, 6, 2)),
        view_of(bed(9, 6, 100, 100), track(9, 6, 5)),
        view_of(bed(91, 61), np.zeros((4, 3)), title="x" * 80),
        view_of(bed(91, 61), track(90, 60, 10), covariances=np.zeros((10, 6, 6))),
    ],
    ids=["some", "two surveys", "many", "two scans", "nothing under it", "does not move", "certain"],
)
def test_no_text_lies_upon_another_or_leaves_the_sheet(view: PartView) -> None:
    assert overlapping_texts(profile_figure(view)) == []


def test_what_is_drawn_is_what_was_counted() -> None:
    view = view_of(bed(91, 61), track(90, 60, 10), PAIRS, frame=SEA)
    profile, figure = profile_of(view), profile_figure(view)
    lines = panels_of(figure)
    assert lines["sensor"] == pytest.approx(np.column_stack([profile.along, profile.vehicle]))
    assert lines["points under the sensor: median"][:, 1] == pytest.approx(profile.bed[1])
    assert lines["ends of loops, 2 scans"][:, 0] == pytest.approx(profile.along[[1, 7]])
    assert lines["not kept, 1"].tolist() == [pytest.approx([profile.overlaps[2, 0], 50.2])]
    assert lines["vertical"][:, 1] == pytest.approx([0.3] * 10)
    depths = figure.axes[0]
    assert depths.get_ylim()[0] > depths.get_ylim()[1]  # depths grow downward
    assert depths.get_ylabel() == "depth [m]"
    assert figure.texts[0].get_text() == "harbor, 2024-05-17: along the track"
    assert figure.get_size_inches().tolist() == pytest.approx([11.7, 8.3])  # a landscape page


def test_lines_break_between_surveys_and_the_surveys_have_their_names() -> None:
    figure = profile_figure(view_of(bed(91, 61), track(90, 60, 10), PAIRS, **TWO))
    sensor = panels_of(figure)["sensor"]
    assert np.flatnonzero(np.isnan(sensor[:, 1])).tolist() == [4]
    assert [text.get_text() for text in figure.axes[0].texts] == ["survey 0 (a)", "survey 1 (b)"]
