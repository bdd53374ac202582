"""gt.log: pairs with their truth, and everything that a line of it can have wrong."""

from pathlib import Path

import numpy as np
import pytest

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.readers.poses.gt_log import read_gt_log

MATRIX = "0 -1 0 4\n1 0 0 5\n0 0 1 6\n0 0 0 1\n"
TWO = f"3 7\n{MATRIX}\n7\t 12  60 \n{MATRIX}"


def written(folder: Path, text: str) -> Path:
    path = folder / "gt.log"
    path.write_text(text)
    return path


def test_pairs_in_order_with_or_without_a_third_number(tmp_path: Path) -> None:
    pairs = read_gt_log(written(tmp_path, TWO))
    assert [(pair.i, pair.j, pair.line) for pair in pairs] == [(3, 7, 1), (7, 12, 7)]
    np.testing.assert_allclose(pairs[0].T_i_j.apply([1, 0, 0]), [4, 6, 6], atol=1e-12)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "holds no line"),
        ("0 1\n0 1 0 4\n1 0", "does not end with a line break"),
        (f"0\n{MATRIX}", r"line 1 is '0'; wanted the numbers of two scans"),
        (f"0 -1\n{MATRIX}", "line 1 is '0 -1'"),
        (f"0 1 2 3\n{MATRIX}", "line 1 is '0 1 2 3'"),
        (f"0 1\n{MATRIX}{MATRIX}", "line 6 is '0 -1 0 4'"),
        (f"4 4\n{MATRIX}", "line 1 pairs the scan 4 with itself"),
        (f"{TWO}0 1\n1 0 0 0\n", "the pair in line 12 has 1 lines of its matrix; wanted four"),
        ("0 1\n" + MATRIX.replace("0 4", "0"), "line 2 has 3 columns"),
        ("0 1\n" + MATRIX.replace("5", "x"), "line 3: 'x' is not a number"),
        ("0 1\n" + MATRIX.replace("6", "nan"), "line 4 holds NaN or infinity"),
        ("0 1\n" + MATRIX.replace("-1", "-1.01"), "pair in line 1 is not a rigid transform .*off by 0.02"),
        ("0 1\n" + MATRIX.replace("-1", "1"), "pair in line 1 is not a rigid transform"),
        ("0 1\n" + MATRIX.replace("0 0 0 1", "0 0 1 1"), "pair in line 1 is not a rigid transform"),
        (f"{TWO}3 7\n{MATRIX}", "lines 1 and 12 are both for the scans 3 and 7; delete one"),
        (f"{TWO}12 7\n{MATRIX}", "lines 7 and 12 are both for the scans 12 and 7; delete one"),
    ],
)
def test_what_cannot_be_used_is_named(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        read_gt_log(written(tmp_path, text))


def test_digits_that_were_cut_off_do_no_harm(tmp_path: Path) -> None:
    (pair,) = read_gt_log(written(tmp_path, "0 1\n0.6 -0.8 0 0\n0.80004 0.6 0 0\n0 0 1 0\n0 0 0 1\n"))
    R = pair.T_i_j.rotation.as_matrix()
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-12)
