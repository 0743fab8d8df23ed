"""Light: the cost of a light volume, and what a field with one saves over path tracing."""

import resource

from . import page
from .outcome import PARTLY, human_bytes
from .rates import bytes_at

TITLE = "Light that is computed once"
RATIO = 10_000  # our goal: the speed of a view from a field over path tracing it
LEAST_PSNR, MOST_NOISE, MOST_SECONDS, LEAST_RATE = 36, 0.01, 90, 0.9


def run(bench, part):
    volume = bench.resampled(48) if bench.quick else bench.volume("brain")
    built = {light: _build(bench, volume, light) for light in ("direct", "global")}
    measured = _compare_with_paths(bench, part, volume, *built["global"])
    if not bench.quick:
        # Nodes one voxel apart would take half an hour where nothing is opaque.
        measured.append(_quality(bench, bench.volume("glass"), "--node-spacing", 2))
        if skull := bench.skull():
            measured.append(_quality(bench, skull, "--node-spacing", 1))
        else:
            part.left_out.append("the CT of a head: invesalius-examples is not installed")
    _show_quality(bench, part, measured)
    _compare_bytes(bench, part, volume, built)


def _build(bench, volume, light):
    """A lossless field, and the processor seconds that it took, its light volume included."""
    path = bench.fields / f"{volume.name}-{light}.slf"
    shape = (4, 16, 1) if bench.quick else (8, 32, 2)
    bench.say(f"building {volume.name} under {light} light")
    before = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime
    bench.run(
        "slf", "build", *volume.arguments(), "-o", path, "-f", "--entry", shape[0], "--exit",
        shape[1], "--levels", shape[2], "--codec", "zstd",
        "--lighting", light, "--light-file", f"{path}.light",
    )  # fmt: skip
    return path, resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime - before


# ---- quality and time ----------------------------------------------------------------------


def _quality(bench, volume, *arguments):
    """What light_quality prints for a volume."""
    bench.say(f"comparing {volume.name} with path tracing")
    views, size, paths = (1, 96, 32) if bench.quick else (2, 256, 256)
    said = bench.json(
        "light_quality", *volume.arguments(), "--views", views, "--size", size,
        "--reference", paths, *arguments,
    )  # fmt: skip
    return {"title": volume.title, **said}


def _compare_with_paths(bench, part, volume, field, build_seconds):
    kept = ["--keep", bench.work / "reference"]
    spacings = "1,2" if bench.quick else "1,1.5,2,3"
    said = _quality(bench, volume, "--node-spacing", spacings, "--field", field, *kept)
    of_field = said["field"]
    samples = "8" if bench.quick else "16,256"
    more = _quality(bench, volume, "--node-spacing", 2, "--samples", samples, *kept)
    said["light"] += more["light"]
    pays = build_seconds / max(of_field["path_tracing_seconds"] - of_field["view_seconds"], 1e-9)
    part.numbers["view"] = {**of_field, "build_seconds": build_seconds, "views_to_pay": pays}
    part.add(
        page.heading("A view from the field, and path tracing it to the same PSNR"),
        page.table(
            ["PSNR", "from the field", "path tracing", "ratio", "building the field", "pays after"],
            [[f"{of_field['psnr']:.1f} dB", f"{of_field['view_seconds'] * 1e3:.2f} ms",
              f"{of_field['path_tracing_seconds']:.2f} s", f"{of_field['ratio']:,.0f}",
              f"{build_seconds:.0f} s", f"{pays:,.0f} views"]],
            f"{volume.title}, under global light; views of {said['size']}² pixels. PSNR is to many "
            "paths a pixel. All times are of the processor. The error of path tracing falls in "
            "proportion to its paths, which gives its time to the field's PSNR.",
        ),
    )  # fmt: skip
    part.claim(
        "slf",
        f"A view from a field takes 1/{RATIO:,} of the time of path tracing it to the same PSNR",
        f"1/{of_field['ratio']:,.0f} at {of_field['psnr']:.1f} dB: "
        f"{of_field['view_seconds'] * 1e3:.2f} ms and {of_field['path_tracing_seconds']:.2f} s; "
        f"the field took {build_seconds:.0f} s to build, which {pays:,.0f} views pay for",
        True if of_field["ratio"] >= RATIO else PARTLY if of_field["ratio"] >= 100 else False,
    )
    return [said]


def _show_quality(bench, part, measured):
    part.numbers["light"] = measured
    part.add(
        page.heading("The light volume"),
        page.table(
            ["volume", "node spacing", "paths a node", "light volume", "noise", "PSNR",
             "slabs, of direct light's"],
            [
                [of["title"], f"{r['spacing']:g}", r["samples"], f"{r['seconds']:.1f} s",
                 f"{r['noise']:.2%}", f"{r['psnr']:.1f} dB", f"{_rate(r):.2f}"]
                for of in measured
                for r in of["light"]
            ],
            "Seconds are of the processor: two cores take half of them. Noise is the standard "
            "deviation over seeds, over the mean. PSNR is to path tracing.",
        ),
    )  # fmt: skip
    first = [(of, of["light"][0]) for of in measured]
    rates = [_rate(r) for _, r in first]
    part.claim(
        "slf",
        f"Rays with a light volume reach {LEAST_RATE:.0%} of the slabs a second of direct light",
        ", ".join(f"{rate:.2f}" for rate in rates),
        min(rates) >= LEAST_RATE,
    )
    if bench.quick:
        return
    shown = [r["psnr"] for _, r in first]
    part.claim(
        "slf",
        f"Views with the light volume reach {LEAST_PSNR} dB to path tracing",
        "; ".join(
            f"{of['title']}: {r['psnr']:.1f} dB with a node spacing of {r['spacing']:g}"
            for of, r in first
        ),
        True if min(shown) >= LEAST_PSNR else PARTLY if max(shown) >= LEAST_PSNR else False,
    )
    brain = first[0][1]
    part.claim(
        "slf",
        f"The brain's light volume takes at most {MOST_SECONDS} s on two cores, with at most "
        f"{MOST_NOISE:.0%} of noise",
        f"{brain['seconds'] / 2:.0f} s, {brain['noise']:.2%}",
        True if brain["seconds"] <= 2 * MOST_SECONDS and brain["noise"] <= MOST_NOISE
        else PARTLY if brain["seconds"] <= 2 * MOST_SECONDS else False,
    )  # fmt: skip


def _rate(row):
    return row["slabs_per_second"] / row["slabs_per_second_direct"]


# ---- bytes ---------------------------------------------------------------------------------


def _compare_bytes(bench, part, volume, built):
    """The same field under both lights, at several qualities."""
    qualities = [60, 90] if bench.quick else [30, 45, 60, 75, 90, 97]
    curves = {}
    for light, (lossless, _) in built.items():
        for quality in qualities:
            path = bench.recoded(lossless, f"predictive:{quality}")
            views = bench.json(
                "slf", "evaluate", path, "--volume", volume.path, "--light-file",
                f"{lossless}.light", "--views", 4, "--size", 256, "--json",
            )  # fmt: skip
            curves.setdefault(light, []).append(
                {"quality": quality, "bytes": path.stat().st_size, "psnr": views["psnr"]}
            )
            path.unlink()
    part.numbers["bytes"] = curves
    part.add(
        page.heading("Bytes"),
        page.table(
            ["light", "codec", "file", "PSNR"],
            [
                [
                    light,
                    f"predictive:{p['quality']}",
                    human_bytes(p["bytes"]),
                    f"{p['psnr']:.2f} dB",
                ]
                for light, curve in curves.items()
                for p in curve
            ],
            "Views from the field beside ray-cast ones under the same light.",
        ),
    )
    # Beyond this quality more bytes hardly improve views under direct light.
    default = {light: next(p for p in curve if p["quality"] == 90)
               for light, curve in curves.items()}  # fmt: skip
    psnr = default["direct"]["psnr"]
    at = {light: bytes_at(curve, psnr) for light, curve in curves.items()}
    if None in at.values():
        told = "no PSNR is common to both; "
    else:
        told = f"{at['global'] / at['direct']:.2f} of the bytes at {psnr:.1f} dB; "
    part.claim(
        "slf",
        "A field under global light needs no more bytes than one under direct light, at equal PSNR",
        told + ", ".join(f"{light} {human_bytes(p['bytes'])} at {p['psnr']:.1f} dB"
                         for light, p in default.items()) + " with predictive:90",
        PARTLY if None in at.values() else at["global"] <= at["direct"],
    )  # fmt: skip
