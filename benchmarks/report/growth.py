"""Growth: costs that stay the same when the field grows, or when the volume does."""

import shutil

import numpy as np

from . import page, plots
from .outcome import PARTLY, human_bytes, human_count

TITLE = "Growth"
# Fields of an analytic scene, entry and exit alike: (cells an edge at level 0, levels).
QUICK_FIELDS = [(8, 0), (16, 0), (16, 1)]
FULL_FIELDS = [(16, 0), (16, 1), (16, 2), (24, 2), (20, 3)]
CODEC = "zstd:1"  # builds fastest without filling the disk
BYTES_PER_SLAB = 0.6  # an upper bound for large fields, to predict whether one fits
LONGEST_BUILD = 1200  # seconds
VOLUMES = [64, 128, 256, 512]


def run(bench, part):
    _grow_field(bench, part)
    _grow_volume(bench, part)


# ---- the field -----------------------------------------------------------------------------


def _grow_field(bench, part):
    scene = bench.scene("balls")
    rows = []
    for side, levels in QUICK_FIELDS if bench.quick else FULL_FIELDS:
        cells = side << levels
        slabs = (4 * cells**2 + 2) ** 2
        reason = _why_not(bench, rows, slabs)
        if reason:
            part.left_out.append(f"a field of {human_count(slabs)} slabs: {reason}")
            break
        begin = bench.seconds()
        field = bench.field(scene, side, side, levels, CODEC)
        seconds = bench.seconds() - begin
        bench.say(f"drawing from {human_count(slabs)} slabs, cold and warm")
        row = bench.json("view_times", field, "--views", 5 if bench.quick else 9, "--size", 512)
        rows.append({"cells": cells, "slabs": slabs, "build_s": seconds, **row})
        if slabs > 1e9:
            field.unlink()  # the next one needs the room
    part.numbers["field"] = rows

    slabs = [r["slabs"] for r in rows]
    fig, axes = plots.figure(4, 1, width=12, height=3)
    for axis, title, unit, series in (
        (axes[0], "Build", "s", [("build_s", "", 1)]),
        (axes[1], "Bytes", "MiB", [("file_bytes", "file", 2**-20),
                                   ("compressed_bytes", "one view", 2**-20)]),
        (axes[2], "Open", "ms", [("open_cold_us", "cold", 1e-3), ("open_warm_us", "warm", 1e-3)]),
        (axes[3], "One view, 512²", "ms", [("view_cold_ms", "cold", 1), ("view_warm_ms", "warm", 1)]),
    ):  # fmt: skip
        for (key, label, scale), color in zip(series, (plots.PAPER, plots.OURS)):
            axis.plot(slabs, [r[key] * scale for r in rows], "o-", color=color, label=label)
        axis.set(xscale="log", yscale="log", xlabel="slabs", ylabel=unit, title=title)
        if len(series) > 1:
            axis.legend(fontsize=8.5)
    part.add(
        page.heading("The field grows"),
        page.plot(plots.svg(fig), f"An analytic scene, {CODEC} for colour and depth, 256 MiB for decoded tiles."),
        page.table(
            ["cells", "slabs", "build", "file", "a view's bytes", "share", "open cold", "open warm",
             "view cold", "view warm"],
            [
                [f"{r['cells']}/{r['cells']}", human_count(r["slabs"]), f"{r['build_s']:.0f} s",
                 human_bytes(r["file_bytes"]), human_bytes(r["compressed_bytes"]),
                 f"{r['compressed_bytes'] / r['file_bytes']:.2%}", f"{r['open_cold_us'] / 1e3:.2f} ms",
                 f"{r['open_warm_us'] / 1e3:.2f} ms", f"{r['view_cold_ms']:.0f} ms",
                 f"{r['view_warm_ms']:.1f} ms"]
                for r in rows
            ],
        ),
    )  # fmt: skip
    first, last = rows[0], rows[-1]
    growth = {k: last[k] / first[k] for k in ("slabs", "file_bytes", "compressed_bytes",
                                              "open_warm_us", "view_warm_ms")}  # fmt: skip
    part.numbers["growth"] = growth
    part.claim(
        "slf",
        "When the field grows, a view's bytes, opening and a warm frame grow far more slowly",
        f"slabs ×{growth['slabs']:.0f}: file ×{growth['file_bytes']:.0f}, a view's bytes "
        f"×{growth['compressed_bytes']:.1f}, opening ×{growth['open_warm_us']:.1f} "
        f"({last['open_warm_us'] / 1e3:.1f} ms), a warm frame ×{growth['view_warm_ms']:.1f}",
        growth["view_warm_ms"] < growth["slabs"] ** 0.5
        and growth["compressed_bytes"] < growth["slabs"] ** 0.75,
    )


def _why_not(bench, rows, slabs):
    """The reason to leave out a field of that size, or None."""
    room = shutil.disk_usage(bench.fields).free
    if room < 2 * BYTES_PER_SLAB * slabs:
        return (
            f"it may need {human_bytes(BYTES_PER_SLAB * slabs)}, and {human_bytes(room)} are free"
        )
    if rows:
        seconds = rows[-1]["build_s"] * slabs / rows[-1]["slabs"]
        if seconds > LONGEST_BUILD:
            return f"building it would take about {seconds / 60:.0f} minutes"
    return None


# ---- the volume ----------------------------------------------------------------------------


def _grow_volume(bench, part):
    sides = VOLUMES[:3] if bench.quick else VOLUMES
    rows = []
    for side in sides:
        volume = bench.resampled(side)
        field = bench.field(volume, 8, 32, 0)
        bench.say(f"timing the brain at {side}³")
        row = {"side": side}
        for r in bench.json(
            "systems", *volume.under_direct_light(), "--field", field,
            "--size", 512, "--views", 2,
            "--repeats", 5, "--json",
        )["rows"]:  # fmt: skip
            row[r["system"]] = r["cpu_ms"]
        rows.append(row)
    part.numbers["volume"] = rows
    fig, axis = plots.figure(width=6.5, height=3.3)
    for key, label, color in (("raycast", "ray-casting", plots.TRUTH),
                              ("bitri", "field, bi-triangle", plots.PAPER),
                              ("depth", "field, depth-corrected", plots.OURS)):  # fmt: skip
        axis.plot([r["side"] for r in rows], [r[key] for r in rows], "o-", color=color, label=label)
    axis.set(
        xscale="log", yscale="log", xlabel="voxels along an edge", ylabel="ms of processor time"
    )
    axis.set_xticks(sides, [str(s) for s in sides])
    axis.minorticks_off()
    axis.legend(fontsize=8.5)
    part.add(
        page.heading("The volume grows"),
        page.plot(plots.svg(fig), "The brain resampled, drawn from fields of one shape; 512²."),
    )
    frames = np.array([[r["bitri"], r["depth"]] for r in rows])
    change = (frames.max(0) / frames.min(0)).max()
    rays = rows[-1]["raycast"] / rows[0]["raycast"]
    part.claim(
        "paper, section 1",
        "The rendering time is a constant, whatever the environment",
        f"from {sides[0]}³ to {sides[-1]}³ frame time changes by {change - 1:.0%} at most; "
        f"ray-casting takes {rays:.1f}× as long",
        True if change < 1.2 else PARTLY if change < 1.5 else False,
    )
