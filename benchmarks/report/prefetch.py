"""Section 5: a loading process beside the rendering one, on a camera path within a memory limit."""

import json

from . import page, plots
from .outcome import PARTLY, human_bytes

TITLE = "Section 5: loading ahead"
KINDS = {
    "wait": ("no loading thread: frames wait", plots.PAPER),
    "demand": ("loading thread, on demand", plots.PLANES),
    "ahead": ("loading thread, ahead of the camera", plots.OURS),
}


def run(bench, part):
    volume = bench.volume("brain")
    # So large that the tiles of a full turn do not fit into the memory limit.
    shape = (8, 8, 2) if bench.quick else (8, 8, 3)
    field = bench.field(volume, *shape, "zstd")
    path = bench.work / "path.json"
    path.write_text(json.dumps(_path()))
    memory = "12MiB" if bench.quick else "48MiB"
    bench.say("flying around, cold, with and without the loading thread")
    played = bench.json(
        "slf", "play", field, "--path", path, "--loading", ",".join(KINDS), "--cold",
        "--memory", memory, "--fps", 15, "--size", "320x320" if bench.quick else "512x512",
        "--json",
    )  # fmt: skip
    runs = {run["loading"]: run for run in played["runs"]}
    part.numbers = {name: run["summary"] for name, run in runs.items()}
    part.numbers["frame_ms"] = {n: [f["ms"] for f in r["frames"]] for n, r in runs.items()}
    _show(part, runs, played, memory, field.stat().st_size)
    _claim(part, runs, played)


def _path():
    """A path around the object that speeds up and turns back, which makes it hard to predict."""
    orbits = [(0, 0, 20, 3), (2, 50, 25, 2.5), (4, 140, 35, 2), (6, 230, 0, 2.2), (7, 200, -20, 2.5),
              (8, 150, -10, 3)]  # fmt: skip
    return {"keys": [{"at": at, "orbit": orbit} for at, *orbit in orbits]}


def _show(part, runs, played, memory, size):
    due = 1e3 / played["fps"]
    fig, axes = plots.figure(2, 1, width=11, height=3.6)
    for name, run in runs.items():
        label, color = KINDS[name]
        frames = run["frames"]
        axes[0].plot([f["ms"] for f in frames], lw=1.1, color=color, label=label)
        axes[1].plot([100 * f["full_share"] for f in frames], lw=1.1, color=color, label=label)
    axes[0].axhline(due, color=plots.INK, ls="--", lw=0.8)
    axes[0].set(xlabel="frame", ylabel="ms", ylim=(0, None),
                title=f"Time of each frame ({due:.0f} ms allowed)")  # fmt: skip
    axes[1].set(xlabel="frame", ylabel="% of the pixels", ylim=(0, 103),
                title="Drawn from the finest level")  # fmt: skip
    axes[1].legend(fontsize=8.5, loc="lower right")
    rows = []
    for name, run in runs.items():
        s = run["summary"]
        rows.append([
            KINDS[name][0], f"{s['mean_ms']:.1f}", f"{s['p95_ms']:.1f}", f"{s['worst_ms']:.1f}",
            f"{s['late']} of {s['frames']}", f"{s['hit_rate']:.1%}", f"{s['full_share']:.1%}",
            human_bytes(s["load_bytes"]), human_bytes(s["rss_anon_peak_bytes"]),
        ])  # fmt: skip
    part.add(
        page.text(
            f"The same path of {played['width_pixels']} × {played['height_pixels']} pixels through "
            f"a field of {human_bytes(size)}, from a cold file, within {memory} of decoded tiles. "
            "Frames that need not wait draw what has not come yet from coarser levels."
        ),
        page.plot(plots.svg(fig)),
        page.table(
            ["", "mean ms", "95 % ms", "worst ms", "late", "tiles at hand", "finest level", "read",
             "memory"],
            rows,
        ),
    )  # fmt: skip


def _claim(part, runs, played):
    wait, ahead, demand = (runs[name]["summary"] for name in ("wait", "ahead", "demand"))
    due = 1e3 / played["fps"]
    part.claim(
        "paper, section 5",
        "A loading process that forecasts the view and loads in advance makes rendering faster",
        f"worst frame {ahead['worst_ms']:.0f} ms instead of {wait['worst_ms']:.0f}, 95 % within "
        f"{ahead['p95_ms']:.0f} instead of {wait['p95_ms']:.0f} (cold, two cores); late for "
        f"{due:.0f} ms: {ahead['late']} instead of {wait['late']} of {wait['frames']}",
        True
        if ahead["p95_ms"] < wait["p95_ms"] and ahead["worst_ms"] < wait["worst_ms"]
        else PARTLY
        if ahead["worst_ms"] < wait["worst_ms"]
        else False,
    )
    part.claim(
        "slf",
        "Forecasting brings more of the finest level in time than loading what the last frame "
        "lacked",
        f"{ahead['full_share']:.1%} of the pixels against {demand['full_share']:.1%}; tiles at "
        f"hand {ahead['hit_rate']:.1%} against {demand['hit_rate']:.1%}",
        ahead["full_share"] > demand["full_share"],
    )
