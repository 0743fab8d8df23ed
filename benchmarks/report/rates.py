"""Rates: bytes of whole fields against the quality of rendered views, codec by codec."""

import statistics

import numpy as np

from . import page, peers, plots
from .bench import Failed
from .outcome import PARTLY, human_bytes

TITLE = "Bytes of a field at equal pictures"
# Opaque, translucent, CT, simulation, labels.
VOLUMES = ["brain", "glass", "head", "bonsai", "engine", "heptane", "atlas", "regions"]
QUALITIES = [45, 60, 75, 90, 97]  # of the first volume
OTHER_QUALITIES = QUALITIES[2:]  # of jpeg, of the other volumes
TRIED = [15, 30, *QUALITIES]  # of the predictive codec, until they enclose the PSNR of jpeg:90
# Other codecs, on the colours of the first volume: name -> settings, best quality last.
PEERS = {
    "WebP": [50, 75, 90],
    "JPEG XL": [4, 2, 1],
    "film, H.264": [34, 28, 22],
    "film, HEVC": [34, 28, 22],
    "film, AV1": [50, 38, 26],
}
AT_MOST = 0.45  # of the bytes of jpeg:90, at its PSNR
STEP_AT_MOST = 1 / 3  # of the bytes that a step of an orbit reads with jpeg:90


def run(bench, part):
    names = [name for name in VOLUMES if name in bench.volumes]
    names = names[:2] if bench.quick else names
    curves = {}
    for name in names:
        whole = name == names[0] and not bench.quick
        curves[name] = _measure(bench, bench.volume(name), whole)
        bench.say(f"{name}: predictive needs {_needs(curves[name])} of the bytes of jpeg:90")
    part.numbers["rates"] = curves
    of_peers = _measure_peers(bench, part, bench.volume(names[0]))
    part.numbers["peers"] = of_peers
    _show(bench, part, curves)
    _show_peers(bench, part, names[0], curves[names[0]], of_peers)
    _claim(bench, part, curves)
    _compare_orbits(bench, part, bench.volume(names[0]))


def _lossless(bench, volume):
    return bench.field(volume, *((4, 16, 1) if bench.quick else (8, 32, 2)), "zstd")


def _views(bench):
    return {"views": 4 if bench.quick else 8, "size": 256}


def _measure(bench, volume, whole):
    """{codec: [{quality, bytes, psnr, ssim}]}, best quality last."""
    lossless, views = _lossless(bench, volume), _views(bench)

    def point(codec, quality):
        path = bench.recoded(lossless, f"{codec}:{quality}")
        found = _point(bench, path, volume, quality, views)
        path.unlink()
        return found

    jpeg = [point("jpeg", q) for q in (QUALITIES if whole else OTHER_QUALITIES)]
    if whole:
        ours = [point("predictive", quality) for quality in QUALITIES]
    else:
        ours = enclosing(lambda quality: point("predictive", quality), _jpeg_90(jpeg)["psnr"])
    return {
        "zstd": [_point(bench, lossless, volume, None, views)],
        "jpeg": jpeg,
        "predictive": ours,
    }


def enclosing(point, psnr):
    """Points with less and more than a PSNR, and one near it if there is a quality between them."""
    at = TRIED.index(90)
    points = [point(TRIED[at])]
    step = -1 if points[0]["psnr"] >= psnr else 1
    while 0 <= at + step < len(TRIED):
        at += step
        points.append(point(TRIED[at]))
        if (points[-1]["psnr"] >= psnr) == (step > 0):
            break
    low, high = sorted(points[-2:], key=lambda p: p["quality"])
    near = round(np.interp(psnr, [low["psnr"], high["psnr"]], [low["quality"], high["quality"]]))
    if low["quality"] < near < high["quality"]:
        points.append(point(near))
    return sorted(points, key=lambda p: p["quality"])


def _jpeg_90(curve):
    return next(point for point in curve if point["quality"] == 90)


def _measure_peers(bench, part, volume):
    """The same of other codecs, which get only the colours of the finest level. Their bytes are
    those of these colours and of depth as jpeg has it; opacity costs them nothing."""
    if not peers.has_ffmpeg():
        part.left_out.append("JPEG XL, H.264, HEVC and AV1: ffmpeg was not found")
    lossless = _lossless(bench, volume)
    depth = 0
    for path, sign in ((bench.recoded(lossless, "jpeg:75"), 1),
                       (bench.recoded(lossless, "jpeg:75", depth=False), -1)):  # fmt: skip
        content = bench.json("slf", "info", path, "--json")
        depth += sign * content["levels"][-1]["payload_bytes"]
        path.unlink()
    truth = peers.Pictures(bench, lossless, "truth")
    curves = {}
    for name, settings in PEERS.items():
        for setting in settings[1:2] if bench.quick else settings:
            try:
                size, decoded = _peer(bench, name, truth, setting)
            except Failed as error:  # not installed, or without this encoder
                bench.say(f"{name} left out: {error}")
                break
            path = peers.recolored(bench, lossless, decoded, "recolored")
            result = bench.evaluate(path, volume, "depth", **_views(bench))
            path.unlink()
            curves.setdefault(name, []).append(
                {
                    "quality": setting,
                    "bytes": size + depth,
                    "psnr": result["psnr"],
                    "ssim": result["ssim"],
                }
            )
    return curves


def _peer(bench, name, truth, setting):
    if name == "WebP":
        return peers.pillow(truth.data, "WEBP", quality=setting, method=4)
    if name == "JPEG XL":
        return peers.jpeg_xl(bench, truth.data, setting)
    return peers.film(bench, truth, name.removeprefix("film, "), setting)


def _point(bench, field, volume, quality, views):
    result = bench.evaluate(field, volume, "depth", **views)
    return {
        "quality": quality, "bytes": field.stat().st_size,
        "psnr": result["psnr"], "ssim": result["ssim"],
    }  # fmt: skip


def bytes_at(curve, psnr):
    """The bytes at which a curve reaches a PSNR, interpolated in their logarithm; None outside."""
    psnrs = [point["psnr"] for point in curve]
    if not min(psnrs) <= psnr <= max(psnrs):
        return None
    return float(np.exp(np.interp(psnr, psnrs, [np.log(point["bytes"]) for point in curve])))


def _share(curves):
    """Bytes of the predictive codec at jpeg:90's PSNR, over those of jpeg:90."""
    jpeg = _jpeg_90(curves["jpeg"])
    reached = bytes_at(curves["predictive"], jpeg["psnr"])
    return reached and reached / jpeg["bytes"]


def _needs(curves):
    share = _share(curves)
    return f"{share:.0%}" if share else "not reached"


def _show(bench, part, curves):
    colors = {"zstd": plots.DIM, "jpeg": plots.PAPER, "predictive": plots.OURS}
    columns = min(len(curves), 4)
    rows = -(-len(curves) // columns)
    for measure, label in (("psnr", "rendered PSNR, dB"), ("ssim", "rendered SSIM")):
        fig, axes = plots.figure(columns, rows, width=3 * columns + 0.6, height=2.9, squeeze=False)
        for axis, (name, of_volume) in zip(axes.flat, curves.items()):
            for codec, curve in of_volume.items():
                axis.plot(
                    [point["bytes"] / 2**20 for point in curve], [p[measure] for p in curve],
                    "o-", ms=4, color=colors[codec], label=codec,
                )  # fmt: skip
            axis.set(xscale="log", xlabel="file, MiB", ylabel=label, title=bench.volume(name).title)
        for axis in list(axes.flat)[len(curves) :]:
            axis.set_axis_off()
        axes.flat[0].legend(fontsize=8.5)
        part.add(page.plot(plots.svg(fig)))
    part.add(
        page.text(
            "Each point is one file, all levels of it, and the mean of random views drawn from it "
            "in mode depth against the ray-cast truth. zstd is the lossless field that the others "
            "are encoded from. Beside jpeg, depth is jpeg:75."
        ),
        page.table(
            ["volume", "codec", "file", "PSNR, dB", "SSIM"],
            [
                [bench.volume(name).title, codec + (f":{p['quality']}" if p["quality"] else ""),
                 human_bytes(p["bytes"]), f"{p['psnr']:.2f}", f"{p['ssim']:.4f}"]
                for name, of_volume in curves.items()
                for codec, curve in of_volume.items()
                for p in curve
            ],
        ),
    )  # fmt: skip


def _show_peers(bench, part, name, ours, others):
    if not others:
        return
    fig, axis = plots.figure(width=10.5, height=4.6)
    lines = {"slf predictive": ours["predictive"], "slf jpeg": ours["jpeg"], **others}
    for k, (codec, curve) in enumerate(lines.items()):
        own = codec.startswith("slf")
        axis.plot(
            [point["bytes"] / 2**20 for point in curve], [point["psnr"] for point in curve], "o",
            ls="--" if codec.startswith("film") else "-", ms=4, lw=2.4 if own else 1.2, label=codec,
            color=plots.OURS if k == 0 else plots.PAPER if k == 1 else plots.plt.cm.Dark2(k),
        )  # fmt: skip
    axis.set(xscale="log", xlabel="MiB", ylabel="rendered PSNR, dB")
    axis.legend(fontsize=8.5, loc="center left", bbox_to_anchor=(1, 0.5))
    part.add(
        page.heading(f"{bench.volume(name).title}: other codecs, by rendered views"),
        page.text(
            "The others get the colours of the finest level as one picture for each entry vertex, "
            "and views are rendered from what they give back. They are counted in their favour: "
            "these colours and depth as jpeg:75, no opacity, no coarser levels, no container. Of "
            f"films (dashed), up to {peers.FILM_GROUP} pictures must be decoded to see one slab."
        ),
        page.plot(plots.svg(fig)),
        page.table(
            ["codec", "setting", "bytes", "PSNR, dB", "SSIM", "slf predictive at this PSNR"],
            [[codec, p["quality"], human_bytes(p["bytes"]), f"{p['psnr']:.2f}", f"{p['ssim']:.4f}",
              _against(bytes_at(ours["predictive"], p["psnr"]), p["bytes"])]
             for codec, curve in others.items() for p in curve],
        ),
    )  # fmt: skip


def _against(ours, theirs):
    return f"{ours / theirs:.0%} of the bytes" if ours else "beyond its curve"


def _claim(bench, part, curves):
    shares = {name: _share(of_volume) for name, of_volume in curves.items()}
    told = ", ".join(f"{bench.volume(name).title}: {_needs(of)}" for name, of in curves.items())
    met = [share is not None and share <= AT_MOST for share in shares.values()]
    part.claim(
        "slf",
        f"predictive needs at most {AT_MOST:.0%} of the bytes of jpeg:90 at its rendered PSNR",
        told,
        True if all(met) else PARTLY if any(met) else False,
    )


def _compare_orbits(bench, part, volume):
    """What an orbit of 120 views, 3 degrees apart, reads when nothing is read twice."""
    lossless, read = _lossless(bench, volume), {}
    for codec in ("jpeg:90", "predictive:90"):
        path = bench.recoded(lossless, codec)
        played = bench.json(
            "slf", "play", path, "--turns", 1, "--seconds", 4, "--fps", 30, "--size", 512,
            "--mode", "depth", "--loading", "wait", "--memory", "4GiB", "--json",
        )  # fmt: skip
        path.unlink()
        first, *steps = (frame["load_bytes"] for frame in played["runs"][0]["frames"])
        read[codec] = {"first": first, "step": statistics.mean(steps), "orbit": first + sum(steps)}
    part.numbers["orbit"] = read
    part.add(
        page.heading("Bytes of an orbit"),
        page.table(
            ["codec", "first view", "each further 3°, mean", "whole orbit"],
            [
                [codec, *(human_bytes(bytes_) for bytes_ in of.values())]
                for codec, of in read.items()
            ],
            f"{volume.title}: views of 512² in mode depth at the finest level, which begin with an "
            "empty cache. Coarser tiles that others are predicted from are included.",
        ),
    )
    share = {key: of / read["jpeg:90"][key] for key, of in read["predictive:90"].items()}
    part.claim(
        "slf",
        "A step of 3° of an orbit reads at most a third of the bytes that it reads with jpeg:90",
        f"{share['step']:.3f}; the first view {share['first']:.3f}, the orbit {share['orbit']:.3f}",
        share["step"] <= STEP_AT_MOST,
    )
