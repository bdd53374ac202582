"""How the page of each group of experiments begins."""

from collections.abc import Mapping
from types import MappingProxyType

from sonarmap.tools.lab.reproduce.experiments import ALL, EVALUATION, KINDS, REAL, SLAM

_PAPER = """# The paper's experiments, reproduced

<!-- not run: sonarmap reproduce: takes hours; tests/tools/lab/reproduce runs each experiment in a small form -->

Bülow and Birk, "Spectral registration of noisy sonar data for underwater 3D mapping", Autonomous Robots 30, 2011, doi
10.1007/s10514-011-9221-8. The paper tests translation, rotation and both together on a simulated scene with four kinds
of noise (Sect. 3), and builds a map from eighteen scans of the Lesumer Sperrwerk, a flood gate near Bremen, taken with
a Tritech Eclipse sonar (Sect. 4). Neither the scene nor the scans are published. So all scans here are simulated, those
of Sect. 4 too, in a scene with a flood gate and in one with clutter (`sonarmap simulate`; `--scene` chooses another).
Field of view, steps and noise are the paper's, and the true pose of every scan is known. The tables show what the paper
reports on its scans next to what this project measures on the simulated ones. This can confirm or refute the paper's
claims, but it cannot reproduce single numbers.

The commands below made this page and its pictures. A command that was stopped continues where it stopped when it is
run again; `--page FILE` writes the page from the results in the output folder. The same seeds, code, device and package
versions give the same rows, tables and pictures, byte for byte; only the times differ. The brackets after a rate hold
its 95 % confidence interval (Wilson's).
"""

_EVALUATION = """# Evaluation on unseen pairs

<!-- not run: sonarmap reproduce: takes hours; tests/tools/lab/reproduce runs each experiment in a small form -->

How well the registration works on pairs that had no part in its development: the scenes, poses and noise come from
seeds that neither development nor the tests use. The results show what to expect on a new pair, as far as simulated
scans can show it. All methods are compared on the same pairs and grids, by the same criteria, each with its default
settings. All scans are simulated (`sonarmap simulate`), so the truth is known for every pair.

The commands below made this page and its pictures. A command that was stopped continues where it stopped when it is
run again; after a change of the code it repeats only the jobs that the change affects. `--page FILE` writes the page
from the results in the output folder. The same seeds, code, device and package versions give the same rows, tables and
pictures, byte for byte, however many `--workers` share the jobs; only the times differ. The brackets after a rate hold
its 95 % confidence interval (Wilson's).
"""

_SLAM = """# Mapping whole surveys

How well mapping works, from scans to one map, compared with other systems. The surveys are simulated
(`sonarmap simulate`), so the truth is known for every pose and every surface. All systems get the same scans, and each
runs with its default settings.

The commands below made this page and its pictures. A command that was stopped continues where it stopped when it is
run again; `--page FILE` writes the page from the results in the output folder. The same seeds, code, device and package
versions give the same rows, tables and pictures, byte for byte; only times and memory differ.
"""

_REAL = """# Real scans

<!-- not run: sonarmap reproduce: needs real scans with known transforms; tests/tools/lab/reproduce/real has some -->

How well the registration works on scans that nobody simulated, compared with other methods on the same points and
grids, each with its default settings.

```sh
sonarmap reproduce real DIR -o OUT
```

registers every pair whose true transform is known. DIR, or each of several folders in it, is a set: scans in any
format that `sonarmap register` reads, whose names end in a number (`7.npy`, `cloud_bin_7.ply`), and a file `gt.log`
with five lines for every pair: the numbers `i j` of the target and the source (or `i j n`; n is not used), then the
four rows of the matrix T with p_i = T p_j, in meters. A `priors.csv` beside them, as `sonarmap register --priors`
reads it, is used: the methods that use priors then register every pair with it and without. `--known attitude,depth`
does the same with measurements that are drawn about the truth, where a set comes without the instruments'
measurements.

The page's commands continue where they stopped when they are run again, and register again only what changed files,
code or options affect. The same files, code, device and package versions give the same rows, tables and pictures, byte
for byte; only the times differ.

## What was used to choose anything

The sets `kitti07` (LiDAR patches, each merged from many sweeps along a street), `outdoor` and `room` (single LiDAR
scans), `kitchen` (RGB-D fragments, each merged from many images) and `pool` (a stacked imaging sonar) are development
data: methods, thresholds and defaults were chosen with them in view, so what the tables show of them is no measure of
what to expect on a new scan. No other real scans were used to choose anything.

These sets lie in `../shared/data` beside the checkout, the kitchen as `redkitchen`; DIR holds links to them. The pool
comes without a gt.log. The one used here has the pair `1 2`, yaw 28.5 degrees and t = (-1.07, -1.16, 0) m, which is
known to 2.5 degrees and 0.15 m, so an error of that size says nothing.
"""

_KINDS = """# Every kind of scan

<!-- not run: sonarmap reproduce: takes hours; tests/tools/lab/reproduce runs each experiment in a small form -->

How well the registration works on scans as different instruments make them: merged patches, swaths, stacked images,
sweeps, sparse, distorted and moving views, each with the errors that go with it. All are simulated, so the truth is
known; [Kinds of scans](simulation.md#kinds-of-scans) says how, and what their sizes were taken from. All methods are
compared on the same pairs and grids, each with its default settings.

```sh
sonarmap reproduce kinds -o OUT --workers 2 --page docs/kinds.md
```

registers 100 pairs of each kind; `--pairs` takes another number, `--method spectral` one method. A command that was
stopped continues where it stopped when it is run again; after a change of the code it repeats only the jobs that the
change affects. The same seeds, code, device and package versions give the same rows, tables and pictures, byte for
byte, however many `--workers` share the jobs; only the times differ. The brackets after a rate hold its 95 % confidence
interval (Wilson's).

## Pairs that had no part in the development

The pairs come from the set 77014, which neither development nor the tests use; `--seed` takes another. Their kinds and
scenes are those of the development, which drew its pairs from other sets: other scenes of the same make, other places,
other noise. That is less than a kind never seen: what holds for one that was left out of the fit, `sonarmap reproduce
judge` says ([Registration](registration.md)).
"""

# By group
INTRODUCTIONS: Mapping[str, str] = MappingProxyType(
    {
        ALL: _PAPER,
        EVALUATION: _EVALUATION,
        SLAM: _SLAM,
        REAL: _REAL,
        KINDS: _KINDS,
    }
)
