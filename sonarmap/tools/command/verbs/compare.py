"""`sonarmap compare`: changes between two surveys of a place."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from sonarmap.kernels.errors import InputError
from sonarmap.tools.command.method import MethodOptions, ViewOptions, configure_method
from sonarmap.tools.command.option import INPUT, OUTPUT, REQUIRED, JsonOption, QuietOption
from sonarmap.tools.command.output import SAME_FRAME, EarthPlace, open_map
from sonarmap.tools.command.terminal import (
    growing_progress,
    number_table,
    print_json,
    print_result,
    result_console,
    say,
    warn,
)
from sonarmap.tools.extras import require

if TYPE_CHECKING:
    from sonarmap.spectral.registration import SpectralRegistrar
    from sonarmap.tools.files.geo import Georeference, Projection
    from sonarmap.tools.files.map_folder.folder import Map
    from sonarmap.tools.products.compare.cloud import PointCloud
    from sonarmap.tools.products.compare.comparison import CompareSettings, Comparison

NOT_ALIGNED = 3


def command(
    old: Annotated[Path, typer.Argument(help="The folder of the earlier map, or a point cloud.", metavar="OLD")],
    earth: EarthPlace,
    view: ViewOptions,
    new: Annotated[
        Path | None, typer.Argument(help="The folder of the later map, or a point cloud.", metavar="NEW")
    ] = None,
    out: Path = OUTPUT.option("OUT", "Folder for the results.", REQUIRED, "-o", "--out"),
    same_frame: bool = INPUT.flag("--same-frame", SAME_FRAME),
    surveys: bool = INPUT.flag("--surveys", "Compare each survey of OLD with the next, without NEW."),
    reach: float | None = INPUT.length("Search distance along the old surface's normal \\[m].", "four voxels"),
    bound: float | None = INPUT.length(
        "Largest level of detection at which a place is called unchanged \\[m].", "two voxels", rare=True
    ),
    cloud_sigma: float | None = INPUT.length(
        "Standard deviation of a coordinate of the point cloud \\[m].", "", shown="from its scatter", rare=True
    ),
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Find what changed between two finished maps of a place.

    Either OLD or NEW may be a point cloud from another program. NEW is aligned with OLD by registration of its views.
    Distances of the surfaces have levels of detection, regions that changed have volumes with sigmas, and areas
    seen in only one survey are never reported as unchanged. The exit code is 0 if they were compared, even if nothing
    changed, 3 if NEW was not found in OLD, 2 for bad input.
    """
    from sonarmap.tools.products.compare.cloud import PointCloud, opened_surveys
    from sonarmap.tools.products.compare.comparison import CompareSettings, NotAlignedError, compare_maps
    from sonarmap.tools.products.compare.files import check_folder

    _check(old, new, surveys, same_frame, cloud_sigma)
    check_folder(out, old, *([] if new is None else [new]))
    settings = CompareSettings(reach, bound)
    if new is not None and old.resolve() == new.resolve():
        warn(f"OLD and NEW are both {old}: nothing can have changed")
    if new is None:
        first = second = folder = open_map(old)
    else:
        first, second, folder = opened_surveys(old, new, cloud_sigma, open_map)
    if isinstance(first, PointCloud) and earth.origin is not None:
        raise InputError(f"--origin has no effect on {old}: a point cloud lies where its CRS says; leave it out")
    first = replace(first, georeference=earth.georeference(first.georeference))
    place = _place(first, earth)
    if place is not None:
        require("rasterio")  # for changes.tif, which is written last
    results: list[tuple[Path, Comparison]] = []
    try:
        if new is None:
            results = _surveys(folder, out, settings)
        else:
            registrar = None if same_frame else _registrar(folder, view.method)
            with growing_progress("aligning NEW with OLD", quiet or as_json) as step:
                results = [(out, compare_maps(first, second, registrar, settings, step))]
    except NotAlignedError as error:
        if as_json:
            print_json({"aligned": False, "reason": str(error)})
        warn(str(error))
        raise typer.Exit(NOT_ALIGNED) from error
    _write(results, place, as_json, in_pairs=new is None)


def _write(
    results: "Sequence[tuple[Path, Comparison]]",
    place: "tuple[Georeference, Projection] | None",
    as_json: bool,
    in_pairs: bool,
) -> None:
    """Write the files of each comparison to its folder, and print the results."""
    from sonarmap.tools.products.compare.files import write_comparison

    contents: list[dict[str, object]] = []
    for out, comparison in results:
        files = write_comparison(out, comparison, place)
        contents.append({**comparison.as_json, "aligned": True, "files": [str(path) for path in files]})
        if not as_json:
            _print(comparison, files)
    if as_json:
        print_json({"pairs": contents} if in_pairs else contents[0])


def _check(old: Path, new: Path | None, surveys: bool, same_frame: bool, cloud_sigma: float | None) -> None:
    """Refuse arguments and options that exclude each other."""
    if new is None and not surveys:
        raise InputError(f"only {old} was given; wanted OLD and NEW, or --surveys to compare the surveys of one map")
    if new is not None and surveys:
        raise InputError("--surveys compares the surveys of one map; leave NEW out, or leave --surveys out")
    if surveys and same_frame:
        raise InputError("--same-frame has no effect with --surveys, which share a frame; leave it out")
    if surveys and cloud_sigma is not None:
        raise InputError("--cloud-sigma has no effect with --surveys, which are no point clouds; leave it out")


def _place(first: "Map | PointCloud", earth: EarthPlace) -> "tuple[Georeference, Projection] | None":
    """The old survey's place on the Earth and projection; None if the place is not known."""
    from sonarmap.tools.products.compare.cloud import PointCloud

    known = first.georeference if isinstance(first, PointCloud) or first.on_earth(first.parts[0]) else None
    projection = earth.projection(known)
    return None if known is None or projection is None else (known, projection)


def _registrar(folder: "Map", method: MethodOptions) -> "SpectralRegistrar":
    """A registrar on the grid that suits the views of a map."""
    from sonarmap.spectral.registration import SpectralRegistrar
    from sonarmap.tools.files.map_folder.folder import surveyed_map

    registrar = configure_method(surveyed_map(folder).key_scans(), method, survey=True).registrar
    assert isinstance(registrar, SpectralRegistrar)  # ViewOptions has no other method
    return registrar


def _surveys(folder: "Map", out: Path, settings: "CompareSettings") -> "list[tuple[Path, Comparison]]":
    """Compare each survey of a map with the next; each comparison has its folder."""
    from sonarmap.tools.products.compare.comparison import compare_surveys

    numbers = sorted(set(folder.surveys(folder.parts[0])))
    if len(numbers) < 2:
        raise InputError(f"{folder.path} has one survey, and --surveys needs several; give NEW instead")
    return [(out / f"survey_{a}_{b}", compare_surveys(folder, a, b, settings)) for a, b in pairwise(numbers)]


def _print(comparison: "Comparison", files: Sequence[Path]) -> None:
    """Print the notes, a row for each changed region, the verdict and the files."""
    for note in comparison.notes:
        say(note)
    if comparison.alignment is not None:
        aligned = comparison.alignment
        print_result(f"{aligned.agreeing} of {aligned.tried} views agree on where {comparison.new} lies")
    if comparison.regions:
        table = number_table(
            "region", "", "area [m2]", "height [m]", "volume [m3]", "sigma [m3]", "x, y, z [m]", words=2
        )
        for number, region in enumerate(comparison.regions, 1):
            numbers = region.area, region.height, region.volume, region.sigma
            where = " ".join(f"{value:.1f}" for value in region.place.tolist())
            kind = "gained" if region.gained else "lost"
            table.add_row(str(number), kind, *(f"{value:,.2f}" for value in numbers), where)
        result_console().print(table)
    print_result(str(comparison))
    print_result(f"written to {files[0].parent}: {', '.join(path.name for path in files)}")
