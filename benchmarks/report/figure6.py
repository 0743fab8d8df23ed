"""Figure 6: how evenly slabs cover the lines, in the plane and in space, and its effect."""

import numpy as np

from . import lines, page, plots
from .outcome import PARTLY, human_count, mean

TITLE = "Figure 6: coverage of line space"
LABELS = {
    "gnomonic": "sphere, the paper's lattice",
    "equal-angle": "sphere, equal angles",
    "equal-area": "sphere, equal areas",
    "touching": "planes touching the sphere",
    "tuned": "planes, tuned",
    "random": "random lines (reference)",
}
COLORS = dict(
    zip(LABELS, [plots.PAPER, "#8a6d3b", plots.OURS, plots.PLANES, "#7f9f3f", plots.TRUTH])
)


def run(bench, part):
    random = np.random.default_rng(1)
    _in_the_plane(part, random)
    _in_space(part, random, 300_000 if bench.quick else 2_000_000)
    _worth(bench, part)


# ---- the paper's own figure ----------------------------------------------------------------


def _in_the_plane(part, random):
    """Chords of a circle, lines between one pair of segments, and between two pairs."""
    extent = np.sqrt(2) + 1  # needed by rays of up to 45° that cross the circle
    few = {
        "circle": lines.circle_lines(24),
        "one pair of lines": lines.pair_lines(17, extent),
    }
    both = [lines.pair_lines(12, extent), lines.pair_lines(12, extent, True)]
    few["two pairs of lines"] = tuple(np.concatenate(e) for e in zip(*both))
    many = {
        "circle": lines.circle_lines(1001),
        "one pair of lines": lines.pair_lines(1001, extent),
    }
    both = [lines.pair_lines(501, extent), lines.pair_lines(501, extent, True)]
    many["two pairs of lines"] = tuple(np.concatenate(e) for e in zip(*both))

    fig, axes = plots.figure(3, 2, width=11, height=3.3)
    numbers = {}
    for column, name in enumerate(few):
        a, b = few[name]
        top, bottom = axes[0, column], axes[1, column]
        for start, end in zip(a, b):
            top.plot(*zip(start, end), color=plots.OURS, lw=0.35, alpha=0.5)
        top.add_patch(plots.plt.Circle((0, 0), 1, fill=False, color=plots.INK, lw=1))
        top.set_aspect("equal")
        top.axis("off")
        top.set_title(f"{name}: {len(a)} rays")
        r, beta = lines.line_space(a, b)
        bottom.scatter(np.degrees(beta), r, s=3, color=plots.OURS, lw=0)
        bottom.set(xlim=(0, 180), ylim=(-1.05, 1.05), xlabel="β, degrees", ylabel="r / R")
        numbers[name] = _plane_evenness(*lines.line_space(*many[name]), random)
        even = numbers[name]
        bottom.set_title(
            f"variation {even['variation']:.2f}, discrepancy {even['discrepancy']:.2f}, "
            f"{even['empty']:.0%} empty", fontsize=9, fontweight="normal",
        )  # fmt: skip
    # A smaller object within the same circle: the paper's adjustable radius.
    r, beta = lines.line_space(*many["circle"])
    share = 0.7
    inner = _plane_evenness(r / share, beta, random)
    numbers["circle, object of 0.7 R"] = inner
    part.numbers["plane"] = numbers
    part.add(
        page.heading("In the plane, as in the paper"),
        page.plot(
            plots.svg(fig),
            "Above: rays between points of a circle, and between points of two lines. Below: the "
            "same rays as points (r, β). Even coverage has variation 0, measured on a million rays "
            "in 24 × 24 bins of |r| ≤ R.",
        ),
    )
    circle, one, two = (numbers[name] for name in few)
    wins = [circle["variation"] < other["variation"] for other in (one, two)]
    part.claim(
        "paper, Figure 6",
        "In the plane, rays between points of a circle cover line space more evenly than rays "
        "between points of two lines",
        f"variation {circle['variation']:.2f} against {one['variation']:.2f} (one pair, "
        f"{one['empty']:.0%} of line space empty) and {two['variation']:.2f} (two pairs); "
        f"{inner['variation']:.2f} where the object takes 0.7 of the radius",
        True if all(wins) else PARTLY if any(wins) else False,
    )


def _plane_evenness(r, beta, random):
    inside = np.abs(r) < 1
    points = np.stack([(r[inside] + 1) / 2, beta[inside] / np.pi], 1)
    return lines.evenness(random.permutation(points), 24, random)[0]


# ---- in space ------------------------------------------------------------------------------


def _in_space(part, random, count):
    slabs = {n: lines.sphere_slabs(s, 64, count, random) for n, s in lines.LATTICES.items()}
    wasted = {}
    for name, planes in {"touching": (-1, 1, 81, 81), "tuned": (-100, 0, 50, 131)}.items():
        points, directions, useful = lines.plane_slabs(*planes, 2 * count, random)
        wasted[name] = 1 - useful.mean()
        slabs[name] = points[useful], directions[useful]
    slabs["random"] = lines.uniform_slabs(count, random)

    numbers, densities = {}, {}
    for name, (points, directions) in slabs.items():
        at = lines.line_coordinates(points, directions)
        numbers[name], densities[name] = lines.evenness(at, (8, 12, 4, 6), random)
        numbers[name]["wasted"] = float(wasted.get(name, 0))
    part.numbers["space"] = numbers

    fig, axis = plots.figure(width=8.5, height=3.6)
    edges = np.geomspace(0.1, 10, 61)
    for name, density in densities.items():
        style = {"ls": "--"} if name == "random" else {"lw": 1.8}
        heights, _ = np.histogram(np.clip(density, 0.1, 10), edges)
        axis.stairs(heights / heights.sum(), edges, label=LABELS[name], color=COLORS[name], **style)
    axis.set(
        xscale="log",
        xlabel="slabs in a part of line space, over their mean",
        ylabel="share of parts",
    )
    axis.set_xticks([0.1, 0.3, 1, 3, 10], ["0.1", "0.3", "1", "3", "10"])
    axis.legend(fontsize=8.5)
    areas = lines.octsphere_cells(lines.gnomonic, 64)[1]
    spread = areas.max() / areas.min()
    part.add(
        page.heading("In space"),
        page.text(
            "Chords of a sphere are exactly uniform among the lines that cross it when their ends "
            "are uniform on it. So the evenness of a sphere light field is that of its points: the "
            "paper's lattice, a grid on each octsphere's flat triangle, is finer at the six axis "
            f"points than in the middle of an octsphere, by {spread:.1f} in area and so "
            f"{spread**2:.0f} for pairs."
        ),
        page.plot(plots.svg(fig)),
        page.plot(_lattice_pictures(), "One octsphere, 16 cells an edge; cells coloured by area."),
        page.table(
            ["", "variation", "95 % / 5 %", "discrepancy", "slabs of no use"],
            [
                [LABELS[n], f"{v['variation']:.2f}", f"{v['ratio']:.1f}", f"{v['discrepancy']:.3f}",
                 f"{v['wasted']:.0%}"]
                for n, v in numbers.items()
            ],
            "Of no use: misses the sphere, or runs in a direction that belongs to another pair.",
        ),
    )  # fmt: skip
    ours, planes, even = numbers["gnomonic"], numbers["touching"], numbers["equal-area"]
    part.claim(
        "paper, section 2",
        "In space, slabs between points of a sphere are more uniform than those between planes",
        f"variation: the paper's lattice {ours['variation']:.2f}, planes "
        f"{planes['variation']:.2f}, points of equal area {even['variation']:.2f}; but "
        f"{planes['wasted']:.0%} of the planes' slabs are of no use, and none of the sphere's",
        True if ours["variation"] < planes["variation"]
        else PARTLY if even["variation"] < planes["variation"] else False,
    )  # fmt: skip
    part.claim(
        "paper, section 2",
        "It needs fewer slabs than planes for the same density",
        f"{planes['wasted']:.0%} and {numbers['tuned']['wasted']:.0%} of the slabs of planes "
        "(touching, tuned) are of no use",
        planes["wasted"] > 0 and numbers["tuned"]["wasted"] > 0,
    )


def _lattice_pictures():
    from matplotlib.collections import PolyCollection

    fig, axes = plots.figure(3, 1, width=10, height=3.2)
    view = np.array([[-1, 1, 0], [-1, -1, 2], [1, 1, 1]]) / np.sqrt([[2], [6], [3]])
    for axis, (name, spread) in zip(axes, lines.LATTICES.items()):
        corners, areas = lines.octsphere_cells(spread, 16)
        cells = PolyCollection((corners @ view.T)[..., :2], array=areas, cmap="viridis",
                               edgecolor="white", lw=0.4)  # fmt: skip
        cells.set_clim(0.25, 2)
        axis.add_collection(cells)
        axis.set_aspect("equal")
        axis.autoscale()
        axis.axis("off")
        axis.set_title(f"{LABELS[name]}\narea {areas.min():.2f} to {areas.max():.2f} of the mean",
                       fontsize=9.5, fontweight="normal")  # fmt: skip
    fig.colorbar(cells, ax=axes, shrink=0.7, label="area / mean")
    return plots.svg(fig)


# ---- the effect on pictures ----------------------------------------------------------------


def _worth(bench, part):
    shapes = [(32, 32)] if bench.quick else [(64, 64), (32, 128)]
    chosen = [bench.volume("brain"), bench.volume("head", "scalp")][: 1 if bench.quick else 2]
    rows, numbers = [], []
    for volume in chosen:
        for entry, exit in shapes:
            slabs = (4 * entry**2 + 2) * (4 * exit**2 + 2)
            edge = (slabs / 6) ** 0.25
            systems = [f"{name}:{entry}:{exit}" for name in lines.LATTICES]
            if entry == exit:
                even, first, second = round(edge), round(edge * 0.62), round(edge / 0.62)
                systems += [f"planes:-1:1:{even}:{even}", f"planes:-100:0:{first}:{second}"]
            bench.say(f"interpolating {volume.title} from traced samples, {entry}/{exit}")
            wanted = [word for system in systems for word in ("--system", system)]
            results = bench.json(
                "sampling_quality", *volume.under_direct_light(),
                *wanted, "--views", 4 if bench.quick else 8,
                "--size", 256, "--json",
            )  # fmt: skip
            numbers.append({"volume": volume.name, "shape": [entry, exit], "results": results})
            for r in results:
                psnr = r["psnr"]
                rows.append([
                    volume.title, _label(r["system"]), f"{entry}/{exit}", human_count(r["slabs"]),
                    f"{psnr.get('bitri', psnr.get('quadrilinear')):.2f}",
                    f"{psnr['depth']:.2f}" if "depth" in psnr else "",
                ])  # fmt: skip
    part.numbers["worth"] = numbers
    part.add(
        page.heading("What evenness is worth in pictures"),
        page.text(
            "Views interpolated straight from traced samples, as floats, without storing anything: "
            "only the parameterisation differs. Same method for all spheres: cells of the "
            "lattice's own triangles, bi-triangle weights, then two corrections by depth. Mean "
            "PSNR of random views."
        ),
        page.table(
            [
                "volume",
                "parameterisation",
                "cells",
                "slabs",
                "interpolated, dB",
                "depth-corrected, dB",
            ],
            rows,
        ),
    )

    def gain(lattice, mode):
        return mean(
            r["results"][list(lines.LATTICES).index(lattice)]["psnr"][mode]
            - r["results"][0]["psnr"][mode]
            for r in numbers
        )

    gains = {(n, m): gain(n, m) for n in ("equal-angle", "equal-area") for m in ("bitri", "depth")}
    part.numbers["gains_db"] = {f"{n}, {m}": g for (n, m), g in gains.items()}
    best = max(gains.values())
    part.claim(
        "slf",
        "A more even lattice than the paper's would not make visibly better pictures, so great "
        "arcs that are straight lines may stay",
        "; ".join(
            f"{n}: {gains[n, 'bitri']:+.2f} dB bi-triangle, {gains[n, 'depth']:+.2f} "
            "depth-corrected"
            for n in ("equal-angle", "equal-area")
        ),
        best < 0.5,
    )


def _label(system):
    kind = system.split(":")[0]
    if kind == "planes":
        kind = "touching" if system.startswith("planes:-1:") else "tuned"
    return LABELS[kind]
