"""Table 1: the time of one picture by ray-casting, by a light field between planes, by ours."""

import numpy as np

from . import page, plots
from .outcome import PARTLY, geometric_mean, human_bytes, human_count, mean

TITLE = "Table 1: rendering time"
# Seconds for one 256 × 256 picture on an SGI Visual Workstation 320 (Table 1 of the paper).
PAPER = {"Otter body": (3.576, 0.137, 0.116), "Segmented brain": (8.652, 0.144, 0.117)}
PAPER_LAYOUT, TUNED = "-1:1", "-100:0"  # where the planes are, in radii
# How many times as fast as VTK: volume, edge of the picture, times.
VTK_TARGETS = [("brain", 256, 25), ("brain", 1024, 30), ("brain-512", 1024, 80)]
# Cells an edge, entry and exit: what a field of this shape is built from.
SHAPES = {"64/64": (8, 8, 3), "32/128": (8, 32, 2)}
QUICK_SHAPES = {"16/16": (8, 8, 1)}
# Smaller fields of the first shape's kind: sides and levels.
SMALLER = [(6, 2), (7, 2), (8, 2), (9, 2), (10, 2), (11, 2), (12, 2), (14, 2)]
QUICK_SMALLER = [(8, 0), (10, 0), (6, 1), (7, 1)]
GOAL = 1.18  # times as fast as planes, the worse of the paper's two
EQUAL = 0.2  # dB that a sphere's picture may be worse than one that it equals


def run(bench, part):
    quick = bench.quick
    sizes = [256, 512] if quick else [256, 512, 1024]
    names = ["brain", "head"] if quick else ["brain", "head", "bonsai", "engine"]
    absent = [n for n in names if n not in bench.volumes]
    if absent:
        part.left_out.append(
            f"volumes that are not there: {', '.join(absent)} (--data names a folder)"
        )
    spare = [v for v in ("scalp", "monkey", "glass") if v in bench.volumes]
    chosen = [
        n if n in bench.volumes else spare.pop(0) for n in names if n in bench.volumes or spare
    ]
    volumes = [bench.volume(name) for name in chosen] + [bench.resampled(512)]

    shapes, cached = (
        {
            cells: {
                v.name: _measure(bench, v, shape, sizes, smaller if k == 0 else [], *options)
                for v in volumes
            }
            for k, (cells, shape) in enumerate((QUICK_SHAPES if quick else SHAPES).items())
        }
        for options, smaller in (
            ((), QUICK_SMALLER if quick else SMALLER), (("--raycast-once",), []))
    )  # fmt: skip
    vtk = _measure_vtk(bench, volumes, [256] if quick else sizes, part)
    part.numbers = {
        "systems": shapes,
        "systems_cached": cached,
        "vtk": vtk,
        "paper_seconds": PAPER,
    }
    titles = {v.name: v.title for v in volumes}
    _show(part, shapes, cached, vtk, titles, sizes)
    _claim(part, shapes, cached, vtk, sizes)


def _measure(bench, volume, shape, sizes, smaller, *options):
    """Ray-casting, planes and spheres of one volume: rows of `systems`."""
    field = bench.field(volume, *shape, "zstd")
    others = [bench.field(volume, side, side, levels, "zstd") for side, levels in smaller]
    bench.say(f"timing views of {field.stem}")
    edge = (_slabs(bench, field) / 6) ** 0.25
    # The best of several shares between both planes, found with sampling_quality.
    tuned = f"{TUNED}:{round(edge * 0.62)}:{round(edge / 0.62)}"
    size = [word for s in sizes for word in ("--size", s)]
    return bench.json(
        "systems", *volume.under_direct_light(),
        *(word for path in [field, *others] for word in ("--field", path)),
        f"--planes={PAPER_LAYOUT}",
        f"--planes={tuned}", *size, "--views", 2 if bench.quick else 4,
        "--repeats", 3 if bench.quick else 7, "--threads", 1, *options, "--json",
    )["rows"]  # fmt: skip


def _slabs(bench, field):
    return bench.json("slf", "info", field, "--json")["levels"][-1]["slabs"]


def _measure_vtk(bench, volumes, sizes, part):
    """VTK beside fields of a shape that suits depth: rows of `vtk_speed` by volume."""
    if not bench.program("vtk_speed"):
        part.left_out.append("VTK's ray-caster: VTK 9 was not found (libvtk9-dev)")
        return {}
    results = {}
    for volume in volumes:
        small = volume.name != "brain" and bench.quick
        fine = volume.name.startswith("brain") and not bench.quick
        field = bench.field(volume, 4 if small else 8, 16 if small else 32, 2 if fine else 1)
        bench.say(f"timing VTK on {volume.title}")
        size = [word for s in sizes for word in ("--size", s)]
        results[volume.name] = bench.json(
            "vtk_speed", *volume.under_direct_light(), "--field", field,
            *size, "--views", 2,
            "--repeats", 3, "--json",
        )["views"]  # fmt: skip
    return results


def _pick(rows, size, start):
    """The rows of a picture size whose system begins with `start`."""
    return [r for r in rows if r["size"] == size and r["system"].startswith(start)]


def _equal(rows, size, layout):
    """Planes, and the smallest sphere in bi-triangle mode whose pictures equal theirs, or None."""
    planes = _pick(rows, size, f"planes:{layout}:")[0]
    as_good = [r for r in _pick(rows, size, "bitri") if r["psnr"] >= planes["psnr"] - EQUAL]
    return planes, min(as_good, key=lambda r: r["slabs"]) if as_good else None


def _gains_of_equal(shapes, sizes, layout):
    """How many times as fast as planes spheres draw equal pictures, by size."""
    rows = next(iter(shapes.values()))
    found = {size: [_equal(of_volume, size, layout) for of_volume in rows.values()]
             for size in sizes}  # fmt: skip
    return {
        size: [planes["cpu_ms"] / sphere["cpu_ms"] if sphere else 0 for planes, sphere in pairs]
        for size, pairs in found.items()
    }


def _over_planes(rows, size):
    """How many times as fast bi-triangle is as the faster planes, in processor time."""
    planes = min(row["cpu_ms"] for row in _pick(rows, size, "planes:"))
    return planes / _pick(rows, size, "bitri")[0]["cpu_ms"]


def _show(part, shapes, cached, vtk, titles, sizes):
    size = sizes[-1]
    cells, rows = next(iter(shapes.items()))
    kinds = [
        ("VTK's ray-caster, all cores", plots.OTHER, None),
        ("our ray-caster", plots.TRUTH, "raycast"),
        ("planes", plots.PLANES, f"planes:{PAPER_LAYOUT}"),
        ("sphere, bi-triangle", plots.PAPER, "bitri"),
        ("sphere, depth-corrected", plots.OURS, "depth"),
    ]
    groups = list(PAPER) + list(rows)
    fig, axis = plots.figure(width=11, height=4.2)
    for k, (label, color, system) in enumerate(kinds):
        values = []
        for group in groups:
            if group in PAPER:
                paper = {"raycast": 0, f"planes:{PAPER_LAYOUT}": 1, "bitri": 2}
                values.append(PAPER[group][paper[system]] * 1e3 if system in paper else np.nan)
            elif system is None:
                values.append(_vtk_mean(vtk, group, size))
            else:
                values.append(_pick(rows[group], size, system)[0]["wall_ms"])
        x = np.arange(len(groups)) + (k - 2) * 0.16
        bars = axis.bar(x, values, 0.15, label=label, color=color)
        axis.bar_label(bars, [_short(v) for v in values], fontsize=7.5)
    axis.set_yscale("log")
    axis.set_ylabel(f"ms for one picture, {cells} cells an edge")
    shown = [
        f"paper: {g}\n256², SGI 320" if g in PAPER else f"{titles[g]}\n{size}²" for g in groups
    ]
    axis.set_xticks(range(len(groups)), shown, fontsize=8.5)
    axis.grid(axis="x", visible=False)
    axis.legend(ncols=5, fontsize=8.5, loc="upper center", bbox_to_anchor=(0.5, 1.12))
    part.add(
        page.text(
            "Planes and sphere have the same number of slabs, the same kind of tiles in memory and "
            "vectors of rays; all draw on one thread. Planes “touching” lie on both sides of the "
            "sphere, as in the paper's Figure 1; “tuned” has directions on one plane and the "
            "object's centre on the other, the best of the arrangements tried with "
            "sampling_quality. A ray takes 16 samples between planes and 9 on the sphere; but "
            "neighbouring samples come two at a time, 8 loads and 6, and to cross two planes takes "
            "less arithmetic than to cross a sphere."
        ),
        page.plot(plots.svg(fig)),
        page.heading("Equal pictures"),
        page.text(
            "What a picture of the same quality costs: beside planes the smallest of several "
            f"spheres whose mean PSNR is at most {EQUAL} dB below theirs, in bi-triangle mode, by "
            "processor time. Memory is that of all samples, 4 bytes each."
        ),
        _table_equal(rows, titles, sizes),
        page.heading("Equal numbers of slabs"),
        page.text(
            "How many times as fast bi-triangle is as the faster of both planes, by processor time; "
            "cells an edge of entry and exit grid. In the first table the ray-caster draws the view "
            "between the frames of the others, as in all that follows, so frames find little in the "
            "CPU's caches; in the second it does not."
        ),
        _table_over_planes(shapes, titles, sizes),
        _table_over_planes(cached, titles, sizes),
        _all_sizes(shapes, titles, sizes),
    )  # fmt: skip
    if vtk:
        part.add(
            page.heading("VTK's CPU ray-caster beside the field"),
            page.table(
                ["volume", "size", "VTK ms", "our ray-caster ms", "field ms", "VTK / field",
                 "field PSNR dB", "VTK's picture and ours, dB"],
                [
                    [titles[n], f"{v['size']}²", f"{v['vtk_ms']:.0f}", f"{v['raycast_ms']:.0f}",
                     f"{v['field_ms']:.1f}", f"{v['vtk_ms'] / v['field_ms']:.0f}×",
                     f"{v['field_psnr']:.1f}", f"{v['vtk_psnr_to_raycast']:.1f}"]
                    for n in vtk for v in vtk[n]
                ],
                "Depth-corrected; entry 16 and exit 64 cells an edge, in the full report 32 and "
                "128 for the brain; same transfer function, light, step and threads.",
            ),
        )  # fmt: skip


def _of_all(rows, size):
    return [_over_planes(of_volume, size) for of_volume in rows.values()]


def _table_over_planes(shapes, titles, sizes):
    columns = [(rows, size) for rows in shapes.values() for size in sizes]
    return page.table(
        ["volume", *(f"{cells}: {size}²" for cells in shapes for size in sizes)],
        [
            [title, *(f"{_over_planes(rows[name], size):.2f}" for rows, size in columns)]
            for name, title in titles.items()
        ]
        + [["mean", *(f"{mean(_of_all(rows, size)):.2f}" for rows, size in columns)]],
    )


def _table_equal(rows, titles, sizes):
    lines = []
    for name, title in titles.items():
        for layout in (PAPER_LAYOUT, TUNED):
            for size in sizes:
                planes, sphere = _equal(rows[name], size, layout)
                cells = (sphere or {}).get("system", "").removeprefix("bitri").removeprefix(":")
                lines.append([
                    title, f"{size}²", _label(planes["system"]), f"{planes['psnr']:.1f}",
                    human_bytes(4 * planes["slabs"]), _short(planes["cpu_ms"]),
                    *([cells or "all", f"{sphere['psnr']:.1f}", human_bytes(4 * sphere["slabs"]),
                       _short(sphere["cpu_ms"]), f"{planes['cpu_ms'] / sphere['cpu_ms']:.2f}"]
                      if sphere else ["none", "", "", "", ""]),
                ])  # fmt: skip
    return page.table(
        ["volume", "size", "planes", "dB", "memory", "ms", "sphere", "dB", "memory", "ms",
         "times as fast"],
        lines,
    )  # fmt: skip


def _all_sizes(shapes, titles, sizes):
    """A line for each system, volume and shape, a column for each size."""
    lines = [
        [f"paper: {name}", "", system, "",
         *(f"{1e3 * seconds:.0f}" if size == 256 else "" for size in sizes), "", ""]
        for name, times in PAPER.items()
        for system, seconds in zip(("ray-caster", "planes", "sphere, bi-triangle"), times)
    ]  # fmt: skip
    for cells, rows in shapes.items():
        for name, measured in rows.items():
            for last in _pick(measured, sizes[-1], ""):
                of_system = [_pick(measured, size, last["system"])[0]["wall_ms"] for size in sizes]
                lines.append([
                    titles[name], cells, _label(last["system"]),
                    human_count(last["slabs"]) if last["slabs"] else "", *map(_short, of_system),
                    _short(last["cpu_ms"]), f"{last['psnr']:.1f}" if "psnr" in last else "truth",
                ])  # fmt: skip
    return page.table(
        ["volume", "cells", "system", "slabs", *(f"{size}², ms" for size in sizes),
         f"{sizes[-1]}², processor ms", "PSNR, dB"],
        lines,
    )  # fmt: skip


def _short(value):
    return "" if value != value else f"{value:.0f}" if value >= 100 else f"{value:.3g}"


def _label(system):
    if system.startswith("planes:"):
        kind = "touching" if system.startswith(f"planes:{PAPER_LAYOUT}:") else "tuned"
        return f"planes, {kind}: {' × '.join(system.split(':')[3:])}"
    mode, _, cells = system.partition(":")
    return {"raycast": "our ray-caster", "bitri": "sphere, bi-triangle",
            "depth": "sphere, depth-corrected"}[mode] + (f", {cells}" if cells else "")  # fmt: skip


def _vtk_mean(vtk, name, size):
    values = [v["vtk_ms"] for v in vtk.get(name, []) if v["size"] == size]
    return mean(values)


def _means(shapes, sizes):
    return "; ".join(
        f"{cells}: {', '.join(f'{mean(_of_all(rows, size)):.2f}' for size in sizes)}×"
        for cells, rows in shapes.items()
    )


def _claim(part, shapes, cached, vtk, sizes):
    size = sizes[-1]
    rows = next(iter(shapes.values()))  # the paper's shape: as many cells at entry and exit

    def gains(measure):
        return [measure(rows[name]) for name in rows]

    equal = {layout: _gains_of_equal(shapes, sizes, layout) for layout in (PAPER_LAYOUT, TUNED)}
    by_layout = {layout: [mean(of) for of in by_size.values()] for layout, by_size in equal.items()}
    part.claim(
        "paper, Table 1",
        f"A picture of equal quality takes less time from the sphere than from planes (by {GOAL}× "
        "and 1.23× in the paper)",
        "; ".join(
            f"{', '.join(f'{gain:.2f}' for gain in gains)}× as fast as {which} planes"
            for which, gains in (("the paper's", by_layout[PAPER_LAYOUT]),
                                 ("the best", by_layout[TUNED]))
        ) + f", at {', '.join(f'{size}²' for size in sizes)}, on the mean",
        True if min(by_layout[PAPER_LAYOUT]) >= GOAL and min(by_layout[TUNED]) >= 1
        else PARTLY if min(by_layout[PAPER_LAYOUT]) >= 1 else False,
    )  # fmt: skip
    every = [gain for of in shapes.values() for size in sizes for gain in _of_all(of, size)]
    means = [mean(_of_all(of, size)) for of in shapes.values() for size in sizes]
    part.claim(
        "paper, Table 1",
        "With as many slabs, one picture takes less time from the sphere than from planes (9 "
        "samples a ray instead of 16)",
        f"{_means(shapes, sizes)} as fast as the faster planes at "
        f"{', '.join(f'{size}²' for size in sizes)}, on the mean (each {min(every):.2f} to "
        f"{max(every):.2f}; processor time); with what they read in the CPU's caches "
        + _means(cached, sizes),
        True if min(means) >= GOAL and min(every) >= 1 else PARTLY if max(every) >= 1 else False,
    )
    over_rays = gains(
        lambda r: _pick(r, size, "raycast")[0]["cpu_ms"] / _pick(r, size, "bitri")[0]["cpu_ms"]
    )
    part.claim(
        "paper, Table 1",
        "Both are much faster than ray-casting (31× and 74× in the paper)",
        f"{min(over_rays):.0f} to {max(over_rays):.0f}× against our ray-caster at {size}²",
        True if min(over_rays) > 25 else PARTLY if min(over_rays) > 2 else False,
    )
    sharper = gains(
        lambda r: _pick(r, size, "bitri")[0]["psnr"]
        - _pick(r, size, f"planes:{PAPER_LAYOUT}")[0]["psnr"]
    )
    tuned = gains(
        lambda r: _pick(r, size, "bitri")[0]["psnr"] - _pick(r, size, f"planes:{TUNED}")[0]["psnr"]
    )
    part.claim(
        "paper, section 1",
        "At equal slabs the sphere's pictures are sharper than those from planes",
        f"{mean(sharper):+.1f} dB over planes that touch the sphere, {mean(tuned):+.1f} dB over "
        "the best planes found",
        True if min(tuned) > 0 else PARTLY if mean(sharper) > 0 else False,
    )
    best = gains(
        lambda r: _pick(r, size, "depth")[0]["psnr"]
        - max(p["psnr"] for p in _pick(r, size, "planes:"))
    )
    part.claim(
        "slf",
        "Depth-corrected, the sphere is at least 4 dB sharper than any planes with as many slabs",
        f"{mean(best):+.1f} dB ({min(best):+.1f} to {max(best):+.1f})",
        True if min(best) >= 4 else PARTLY if mean(best) >= 4 else False,
    )
    for name, edge, target in VTK_TARGETS:
        views = [v for v in vtk.get(name, []) if v["size"] == edge]
        if not views:
            continue
        ratio = geometric_mean(v["vtk_ms"] / v["field_ms"] for v in views)
        part.claim(
            "slf",
            f"Depth-corrected views of {edge}² are at least {target}× as fast as VTK's ray-caster "
            "on " + ("the brain" if name == "brain" else "the brain resampled to 512³"),
            f"{ratio:.0f}×, {mean(v['field_psnr'] for v in views):.1f} dB",
            True if ratio >= target else PARTLY if ratio >= target / 2 else False,
        )
