"""Rates: bytes of whole fields against the quality of rendered views, codec by codec."""

import numpy as np

from . import page, plots
from .outcome import PARTLY, human_bytes

TITLE = "Bytes of a field at equal pictures"
# Opaque, translucent, CT, simulation, labels.
VOLUMES = ["brain", "glass", "head", "bonsai", "engine", "heptane", "atlas", "regions"]
QUALITIES = [45, 60, 75, 90, 97]
AT_MOST = 0.45  # of the bytes of jpeg:90, at its PSNR


def run(bench, part):
    names = [name for name in VOLUMES if name in bench.volumes]
    names = names[:2] if bench.quick else names
    curves = {}
    for name in names:
        curves[name] = _measure(bench, bench.volume(name))
        bench.say(f"{name} done")
    part.numbers["rates"] = curves
    _show(bench, part, curves)
    _claim(bench, part, curves)


def _measure(bench, volume):
    """{codec: [{quality, bytes, psnr, ssim}]}, best quality last."""
    shape = (4, 16, 1) if bench.quick else (8, 32, 2)
    lossless = bench.field(volume, *shape, "zstd", "zstd")
    qualities = QUALITIES[2:] if bench.quick else QUALITIES
    views = {"views": 4 if bench.quick else 8, "size": 256}
    curves = {"zstd": [_point(bench, lossless, volume, None, views)]}
    for codec, depth in (("jpeg", "jpeg:75"), ("predictive", None)):
        for quality in qualities:
            path = bench.recoded(lossless, f"{codec}:{quality}", depth)
            curves.setdefault(codec, []).append(_point(bench, path, volume, quality, views))
            path.unlink()
    return curves


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
    jpeg = next(point for point in curves["jpeg"] if point["quality"] == 90)
    reached = bytes_at(curves["predictive"], jpeg["psnr"])
    return reached and reached / jpeg["bytes"]


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
            "Each point is one file, all levels of it, and the mean of random views drawn from it in "
            "mode depth against the ray-cast truth. zstd is the lossless field that the others are "
            "encoded from. Beside jpeg, depth is jpeg:75."
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


def _claim(bench, part, curves):
    shares = {name: _share(of_volume) for name, of_volume in curves.items()}
    told = ", ".join(
        f"{bench.volume(name).title}: {share:.0%}" if share else f"{bench.volume(name).title}: not reached"
        for name, share in shares.items()
    )
    met = [share is not None and share <= AT_MOST for share in shares.values()]
    part.claim(
        "slf",
        f"predictive needs at most {AT_MOST:.0%} of the bytes of jpeg:90 at its rendered PSNR",
        told,
        True if all(met) else PARTLY if any(met) else False,
    )
