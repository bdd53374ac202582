"""How far roll, pitch and yaw carry: what the resampling is off by under tilt (Sect. 2.7, Figs. 7 to 9)."""

from collections.abc import Sequence
from pathlib import Path
from time import perf_counter

import numpy as np
from scipy.spatial.transform import Rotation

from sonarmap.spectral.hemisphere.registration import LayeredScan
from sonarmap.tools.lab.reproduce.experiment import Outcome, Row
from sonarmap.tools.lab.reproduce.experiments import Request
from sonarmap.tools.lab.reproduce.settings import as_asked
from sonarmap.tools.lab.reproduce.structures.limits_section import (
    DEVIATIONS,
    PEAKS,
    Peaks,
    draw_deviations,
    draw_peaks,
    limits_section,
)
from sonarmap.tools.lab.reproduce.structures.moved import StructureExperiment
from sonarmap.tools.lab.reproduce.structures.settings import LimitsSettings

KINDS = ("none", "roll", "pitch", "both")
_FARTHEST = np.deg2rad(60.0)  # how far roll and pitch are looked for, so that a bound does not help
_SHOWN_YAW = 40.0  # of the correlations that are drawn [degrees]


class Limits(StructureExperiment):
    """The experiment: one job per scene, seed, and what is tilted."""

    name = "limits"
    make_section = staticmethod(limits_section)

    def jobs(self) -> Sequence[str]:
        """As in "floodgate/1/both"."""
        return [f"{scene}/{seed}/{kind}" for scene, seed in self.settings.structures for kind in KINDS]

    def run(self, job: str) -> Outcome:
        """All tilts of one kind under all yaws."""
        scene, seed, kind = job.split("/")
        points = self.structure(scene, int(seed))
        still = self.prepare(points, "D0", [0])
        rows, seconds = [], []
        for tilt in (0.0,) if kind == "none" else self.settings.tilts_deg:
            for yaw in self.settings.yaws_deg:
                start = perf_counter()
                truth = _turn(kind, tilt, yaw)
                deviations = self._steps(self.prepare(truth.apply(points), "D0", [0]), still, truth)
                rows.append(
                    {"scene": scene, "seed": int(seed), "tilted": kind, "tilt_deg": tilt, "yaw_deg": yaw} | deviations
                )
                seconds.append({"job": job, "tilt_deg": tilt, "yaw_deg": yaw, "seconds": perf_counter() - start})
        return Outcome(tuple(rows), tuple(seconds))

    def draw(self, folder: Path, rows: Sequence[Row]) -> None:
        """Correlations of the first structure, and the deviations of all."""
        draw_peaks(folder / PEAKS, [self._peaks(tilt) for tilt in _four(self.settings.tilts_deg)])
        draw_deviations(folder / DEVIATIONS, rows)

    def _steps(self, target: LayeredScan, source: LayeredScan, truth: Rotation) -> dict[str, float]:
        """Each step for itself: yaw as it is read off first, roll and pitch with yaw known, and the whole chain."""
        registrar = self.registrar
        true_yaw = truth.as_euler("ZYX", degrees=True)[0]
        yaw = registrar.hemisphere.yaw_candidates(target.layers, source.layers, 1)[0]
        off = np.rad2deg(yaw.R.as_rotvec()[2]) - true_yaw
        known = Rotation.from_euler("Z", true_yaw, degrees=True)
        tilt = registrar.hemisphere.tilt(target.layers, source.magnitude, known, _FARTHEST)
        R = known if tilt is None else tilt.R * known
        _, pitch, roll = R.as_euler("ZYX", degrees=True) - truth.as_euler("ZYX", degrees=True)
        chain = registrar.register(target, source)
        return {
            "yaw_off_deg": float((off + 90) % 180 - 90),  # the peak repeats after half a turn
            "yaw_psr": yaw.psr,
            "roll_off_deg": float(roll),
            "pitch_off_deg": float(pitch),
            "tilt_psr": 0.0 if tilt is None else tilt.psr,
            "chain_off_deg": float(np.rad2deg((truth.inv() * chain.T_target_source.rotation).magnitude())),
            "chain_shift_voxels": float(np.linalg.norm(chain.T_target_source.translation) / self.settings.grid.voxel),
        }

    def _peaks(self, tilt: float) -> Peaks:
        """Both correlations of the first structure with roll and pitch of `tilt` [degrees]."""
        settings, hemisphere = self.settings, self.registrar.hemisphere
        points = self.structure(settings.scenes[0], settings.first_seed)
        still = self.prepare(points, "D0", [0])
        turned, tilted = (self.prepare(_turn("both", tilt, yaw).apply(points), "D0", [0]) for yaw in (_SHOWN_YAW, 0.0))
        image = hemisphere.tilt_correlation(tilted.layers, still.magnitude, Rotation.identity()).get()
        return Peaks(
            tilt_deg=tilt,
            yaw_deg=_SHOWN_YAW,
            image=np.fft.fftshift(image),
            image_bin_deg=float(np.rad2deg(hemisphere.tilt_bin)),
            row=hemisphere.yaw_correlation(turned.layers, still.layers),
            row_bin_deg=float(np.rad2deg(hemisphere.yaw_bin)),
        )


def _turn(kind: str, tilt: float, yaw: float) -> Rotation:
    pitch = tilt if kind in ("pitch", "both") else 0.0
    roll = tilt if kind in ("roll", "both") else 0.0
    return Rotation.from_euler("ZYX", [yaw, pitch, roll], degrees=True)


def _four(angles: Sequence[float]) -> list[float]:
    """Up to four of them, evenly spread, the first and the last among them."""
    return [angles[k] for k in sorted({round(x) for x in np.linspace(0, len(angles) - 1, 4)})]


def create(request: Request) -> Limits:
    """The experiment as the command line asks for it."""
    quick = {"scenes": ("floodgate",), "seeds": 1, "tilts_deg": (10.0, 20.0, 35.0), "yaws_deg": (-40.0, 40.0)}
    return Limits(as_asked(LimitsSettings(), request, **quick), request.opened)
