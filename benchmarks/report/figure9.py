"""Figure 9 and section 4: the subdivision, what share of a field one view needs, and its memory."""

import numpy as np

from . import lines, page, plots
from .outcome import PARTLY, human_bytes

TITLE = "Figure 9 and section 4: subfields and memory per view"
LEVELS = range(4)
DISTANCES = [1.2, 1.5, 2, 3, 5, 10]


def run(bench, part):
    _draw_subdivision(part)
    _count_subfields(bench, part)
    _measure_memory(bench, part)


def _draw_subdivision(part):
    from matplotlib.collections import PolyCollection

    eye = np.array([1.0, -0.75, 0.6])
    eye /= np.linalg.norm(eye)
    right = np.cross([0, 0, 1], eye)
    right /= np.linalg.norm(right)
    view = np.stack([right, np.cross(eye, right), eye])
    fig, axes = plots.figure(4, 1, width=11, height=3.5)
    for level, axis in zip(LEVELS, axes):
        shown, colors = [], []
        for octant in range(8):
            signs = np.array([-1 if octant >> k & 1 else 1 for k in range(3)])
            for k, corners in enumerate(lines.octsphere_cells(lines.gnomonic, 2**level)[0]):
                outline = np.concatenate([
                    lines.gnomonic(a + t * (b - a))
                    for a, b in zip(corners, np.roll(corners, -1, 0))
                    for t in [np.linspace(0, 1, 12)[:-1, None]]
                ]) * signs @ view.T  # fmt: skip
                ahead = outline[:, 2] > 0
                if ahead.any():
                    # Points behind the horizon are drawn on the horizon.
                    flat = outline[:, :2]
                    flat[~ahead] /= np.linalg.norm(flat[~ahead], axis=1)[:, None]
                    shown.append(flat)
                    colors.append(plots.plt.cm.Set2(octant, 0.55 + 0.15 * (k % 4)))
        axis.add_collection(PolyCollection(shown, facecolors=colors, edgecolors=plots.INK, lw=0.6))
        axis.set(xlim=(-1.03, 1.03), ylim=(-1.03, 1.03), aspect="equal")
        axis.axis("off")
        axis.set_title(f"level {level}: {8 * 4**level} sections\n{64 * 16**level:,} subfields",
                       fontsize=9.5, fontweight="normal")  # fmt: skip
    part.add(
        page.plot(plots.svg(fig), "Each section splits into four by three arcs of great circles.")
    )


# ---- how many subfields a view needs -------------------------------------------------------


def _count_subfields(bench, part):
    # Which subfields a view crosses depends on geometry alone, so the smallest field suffices.
    field = bench.field(bench.scene("globe"), 1, 1, LEVELS[-1], "raw", depth=False)
    rows = {}
    for distance in DISTANCES:
        bench.say(f"counting subfields from {distance} radii")
        measured = bench.json(
            "slf", "measure", field, "--views", 16 if bench.quick else 128, "--size", 256,
            "--distance", distance, "--mode", "bitri", "--json",
        )  # fmt: skip
        rows[distance] = {row["level"]: row for row in measured["runs"][0]["levels"]}
    part.numbers["subfields"] = rows

    fig, axes = plots.figure(2, 1, width=10, height=3.3)
    for k, distance in enumerate(DISTANCES):
        share = [rows[distance][level]["pair_fraction"]["mean"] for level in LEVELS]
        axes[0].plot(
            LEVELS, share, "o-", label=f"{distance:g} R", color=plots.plt.cm.viridis(k / 6)
        )
    axes[0].axhline(0.25, color=plots.PAPER, ls="--", lw=1)
    axes[0].text(3, 0.27, "the paper's 1/4", color=plots.PAPER, ha="right", fontsize=9)
    axes[0].set(yscale="log", xlabel="level", ylabel="share of the subfields", xticks=list(LEVELS),
                title="A view crosses")  # fmt: skip
    axes[0].legend(title="eye from the centre", fontsize=8.5, title_fontsize=8.5)
    pairs = [rows[d][0]["pairs_crossed"] for d in DISTANCES]
    axes[1].plot(DISTANCES, [p["mean"] for p in pairs], "o-", color=plots.OURS, label="mean")
    axes[1].plot(DISTANCES, [p["max"] for p in pairs], "o:", color=plots.OURS, label="most")
    axes[1].axhline(16, color=plots.PAPER, ls="--", lw=1)
    axes[1].text(10, 16.4, "the paper's 16", color=plots.PAPER, ha="right", fontsize=9)
    axes[1].set(xlabel="eye from the centre, radii", ylabel="of 64 subfields", ylim=(0, None),
                title="At level 0")  # fmt: skip
    axes[1].legend(fontsize=8.5)
    part.add(
        page.heading("How much of a field one view needs"),
        page.plot(plots.svg(fig), "Random directions, the whole sphere in the picture."),
    )

    usual = rows[3][0]
    lowest, highest = (f(p["mean"] for p in pairs) for f in (min, max))
    fewer = sum(p["mean"] < 16 for p in pairs)
    part.claim(
        "paper, section 4",
        "Usually fewer than 16 of the 64 subfields are needed at one time",
        f"{usual['pairs_crossed']['mean']:.1f} on average and {usual['pairs_crossed']['max']:.0f} "
        f"at most from 3 radii; averages {lowest:.1f} to {highest:.1f} from {DISTANCES[0]} to "
        f"{DISTANCES[-1]} radii",
        True if fewer == len(pairs)
        else PARTLY if fewer or usual["pairs_crossed"]["mean"] < 20
        else False,  # fmt: skip
    )  # fmt: skip
    finer = rows[3][1]["pair_fraction"]
    part.claim(
        "paper, section 4",
        "No more than 1/4 of the whole field is loaded at one time",
        f"{usual['pair_fraction']['mean']:.0%} on average, {usual['pair_fraction']['max']:.0%} at "
        f"most with 64 subfields; {finer['mean']:.1%} and {finer['max']:.1%} when they are "
        "subdivided once",
        True if usual["pair_fraction"]["max"] <= 0.25
        else PARTLY if finer["max"] <= 0.25 else False,
    )  # fmt: skip
    sections = [round(rows[3][level]["tiles"] ** 0.5) for level in LEVELS]
    part.claim(
        "paper, section 4",
        "After the second subdivision there are 52 sections",
        f"{sections[1]} (level by level: {', '.join(map(str, sections))})",
        sections[1] == 52,
    )


# ---- the same in bytes ---------------------------------------------------------------------


def _measure_memory(bench, part):
    """The same samples, cut into subfields at each level of subdivision."""
    volume, finest = bench.volume("brain"), 16 if bench.quick else 32
    rows = []
    for level in LEVELS:
        side = finest >> level
        field = bench.field(volume, side, side, level, "jpeg:90")
        bench.say(f"measuring memory per view, subdivided {level} times")
        measured = bench.json(
            "slf", "measure", field, "--views", 16, "--level", level, "--mode", "depth", "--json",
            "--memory", "2GiB",
        )  # fmt: skip
        row = measured["runs"][0]["levels"][0]
        row["payload"] = bench.json("slf", "info", field, "--json")["levels"][level]["payload_bytes"]
        rows.append(row)
    part.numbers["memory"] = rows

    fig, axis = plots.figure(width=6.5, height=3.4)
    for key, label, color, scale in (
        ("decoded_peak_bytes", "decoded, at the peak", plots.TRUTH, 1),
        ("map_pages", "pages of the file", plots.PLANES, 4096),
        ("compressed_bytes", "compressed payloads", plots.OURS, 1),
    ):
        values = [row[key]["mean"] * scale / 2**20 for row in rows]
        axis.plot(LEVELS, values, "o-", color=color, label=label)
    axis.set(yscale="log", xlabel="subdivisions", ylabel="MiB for one view", xticks=list(LEVELS))
    axis.legend(fontsize=8.5)
    part.add(
        page.heading("Memory for one view"),
        page.plot(
            plots.svg(fig),
            f"The same samples of the brain, {finest} cells an edge, in 64, 1,024, 16,384 and "
            "262,144 subfields; depth-corrected views of 512² from 3 radii.",
        ),
        page.table(
            ["subdivisions", "subfields", "needed", "share", "compressed bytes", "of the level",
             "pages", "decoded"],
            [
                [level, f"{r['tiles']:,}", f"{r['tiles_touched']['mean']:.0f}",
                 f"{r['fraction']['mean']:.2%}", human_bytes(r["compressed_bytes"]["mean"]),
                 f"{r['compressed_bytes']['mean'] / r['payload']:.1%}",
                 f"{r['map_pages']['mean']:.0f}", human_bytes(r["decoded_peak_bytes"]["mean"])]
                for level, r in zip(LEVELS, rows)
            ],
            "With the neighbours that interpolation needs across the borders of sections.",
        ),
    )  # fmt: skip
    decoded = [row["decoded_peak_bytes"]["mean"] for row in rows]
    touched = [row["compressed_bytes"]["mean"] for row in rows]
    part.claim(
        "paper, section 4",
        "The more subdivision, the less memory is needed during rendering",
        f"decoded: {', '.join(human_bytes(b) for b in decoded)}; compressed: "
        f"{', '.join(human_bytes(b) for b in touched)}, for 0 to {LEVELS[-1]} subdivisions, of "
        f"which the last leaves subfields of {finest >> LEVELS[-1]} cells an edge",
        True if decoded == sorted(decoded, reverse=True)
        else PARTLY if min(decoded) < decoded[0] / 1.5 else False,
    )  # fmt: skip
