"""Compression: a field's bytes against the quality of its pictures, and other codecs."""

import numpy as np

from . import page, peers, plots
from .bench import Failed
from .outcome import NOT_RUN, PARTLY, Claim, human_bytes

TITLE = "Compression"
PAPER_CODEC = "jpeg:75"
# Ratios and PSNR that others report; quoted, not measured here.
PUBLISHED = [
    ("Levoy & Hanrahan 1996: vector quantisation and gzip", "118 : 1", "not given"),
    ("random-access light field codecs", "20–200 : 1", "50–40 dB"),
    ("the same, later", "30–800 : 1", "40–45 dB"),
]


def run(bench, part):
    volume = bench.volume("brain")
    shapes = _shapes(bench)
    settings = _measure_settings(bench, volume, shapes)
    _show_settings(part, settings)
    _claim_paper(part, settings)
    _compare_codecs(bench, part, volume, shapes[-1])
    _compare_speeds(bench, part, volume, shapes[-1])
    _published(part)


def _shapes(bench):
    """Lattices as (entry, exit, levels): the paper's, one of as many slabs, one of 1/16 of them."""
    if bench.quick:
        return [(8, 8, 2), (4, 16, 2), (8, 32, 0)]
    return [(8, 8, 3), (8, 32, 2), (8, 32, 1)]


# ---- our settings, by rendered pictures ----------------------------------------------------


def _measure_settings(bench, volume, shapes):
    rows = []
    for k, shape in enumerate(shapes):
        lossless = bench.field(volume, *shape, "zstd")
        cells = (shape[0] << shape[2], shape[1] << shape[2])
        views = {"views": 4 if bench.quick else 8, "size": 256 if bench.quick else 512}
        qualities = ["50", "75", "95", "75:444"] if bench.quick else ["50", "65", "75", "85", "95"]
        if not bench.quick:
            qualities += ["50:444", "75:444", "90:444"]
        codecs = ["zstd", *(f"jpeg:{q}" for q in qualities)]
        if k == len(shapes) - 1:
            codecs.insert(0, "raw")
        for codec in codecs:
            field = lossless if codec == "zstd" else bench.recoded(lossless, codec)
            without = bench.recoded(field, codec, depth=False)
            for path, mode in ((field, "depth"), (without, "bitri")):
                quality = bench.evaluate(path, volume, mode, **views)
                rows.append({
                    "cells": cells, "codec": codec, "depth": mode == "depth",
                    "bytes": path.stat().st_size, "psnr": quality["psnr"], "ssim": quality["ssim"],
                })  # fmt: skip
            for path in {without, field} - {lossless}:
                path.unlink()
        bench.say(f"{cells[0]}/{cells[1]} done")
    return rows


def _show_settings(part, rows):
    part.numbers["settings"] = rows
    shapes = list(dict.fromkeys(tuple(r["cells"]) for r in rows))
    fig, axis = plots.figure(width=10.5, height=4.6)
    colors = dict(zip(shapes, [plots.PAPER, plots.OURS, plots.PLANES]))
    for shape in shapes:
        for depth in (True, False):
            label = f"{shape[0]}/{shape[1]} " + (
                "depth-corrected" if depth else "bi-triangle, no depth"
            )
            style = "-" if depth else ":"
            line = [r for r in rows if r["cells"] == shape and r["depth"] == depth]
            jpeg = [r for r in line if r["codec"].startswith("jpeg") and ":444" not in r["codec"]]
            jpeg.sort(key=lambda r: r["bytes"])
            at = lambda rs: (
                [r["bytes"] / 2**20 for r in rs],
                [r["psnr"] for r in rs],
            )  # noqa: E731
            axis.plot(*at(jpeg), "o" + style, ms=5, color=colors[shape], label=label)
            full = [r for r in line if ":444" in r["codec"]]
            axis.plot(*at(full), "^", ms=6, mfc="none", color=colors[shape])
            whole = [r for r in line if r["codec"] in ("zstd", "raw")]
            axis.plot(*at(whole), "s", ms=5, mfc="white", color=colors[shape])
    axis.plot([], [], "^", mfc="none", color=plots.INK, label="full chroma (4:4:4)")
    axis.plot([], [], "s", mfc="white", color=plots.INK, label="lossless: zstd, raw")
    axis.set(xscale="log", xlabel="file, MiB", ylabel="rendered PSNR, dB")
    axis.legend(fontsize=8.5, loc="center left", bbox_to_anchor=(1, 0.5))
    part.add(
        page.text(
            "Each point is one file of the brain: its size, and the PSNR of random views rendered "
            "from it against the ray-cast truth. Lines join JPEG qualities with 4:2:0 chroma. "
            "Cells an edge are given as entry/exit."
        ),
        page.plot(plots.svg(fig)),
        page.folded(
            f"All {len(rows)} settings",
            page.table(
                ["cells", "codec", "depth", "file", "PSNR, dB", "SSIM"],
                [
                    [f"{r['cells'][0]}/{r['cells'][1]}", r["codec"], "yes" if r["depth"] else "no",
                     human_bytes(r["bytes"]), f"{r['psnr']:.2f}", f"{r['ssim']:.4f}"]
                    for r in rows
                ],
            ),
        ),
    )  # fmt: skip


def _claim_paper(part, rows):
    """Ours at a sixteenth of the slabs against the paper's layout with the paper's codec."""
    shapes = list(dict.fromkeys(tuple(r["cells"]) for r in rows))
    paper = next(
        r for r in rows if r["cells"] == shapes[0] and r["codec"] == PAPER_CODEC and not r["depth"]
    )
    lossy = [
        r for r in rows
        if r["cells"] == shapes[-1] and r["codec"].startswith("jpeg") and r["depth"]
    ]  # fmt: skip
    better = [r for r in lossy if r["psnr"] > paper["psnr"]]
    ours = min(better, key=lambda r: r["bytes"]) if better else max(lossy, key=lambda r: r["psnr"])
    factor = paper["bytes"] / ours["bytes"]
    name = lambda shape: f"{shape[0]}/{shape[1]}"  # noqa: E731
    part.claim(
        "slf",
        f"{name(shapes[-1])} with depth makes better pictures than the paper's "
        f"{name(shapes[0])} bi-triangle with {PAPER_CODEC}, from at most 1/12 of the bytes",
        f"{ours['codec']}: {human_bytes(ours['bytes'])}, {ours['psnr']:.1f} dB; paper's "
        f"{human_bytes(paper['bytes'])}, {paper['psnr']:.1f} dB: 1/{factor:.1f} of the bytes, "
        f"{ours['psnr'] - paper['psnr']:+.1f} dB",
        True if better and factor >= 12 else PARTLY if better and factor > 4 else False,
    )
    find = lambda codec, shape: next(  # noqa: E731
        r for r in rows if r["cells"] == shape and r["codec"] == codec and r["depth"]
    )
    lossless, small = find("zstd", shapes[-1]), find("jpeg:75", shapes[-1])
    raw = find("raw", shapes[-1])
    part.claim(
        "paper, section 4",
        "Public compression such as JPEG can be used for sphere light fields",
        f"{name(shapes[-1])}: JPEG 75 is {raw['bytes'] / small['bytes']:.0f} : 1 against raw and "
        f"costs {lossless['psnr'] - small['psnr']:.1f} dB of {lossless['psnr']:.1f} in rendered "
        f"pictures; lossless {raw['bytes'] / lossless['bytes']:.1f} : 1",
        lossless["psnr"] - small["psnr"] < 1.5 and raw["bytes"] > 5 * small["bytes"],
    )


# ---- other codecs on the same samples ------------------------------------------------------


def _psnr(truth, decoded):
    error = np.mean((truth.astype(np.float32) - decoded) ** 2, dtype=np.float64)
    return float(10 * np.log10(255**2 / error)) if error > 0 else float("inf")


def _compare_codecs(bench, part, volume, shape):
    """Bits per slab and PSNR of the samples themselves, colour only."""
    lossless = bench.field(volume, *shape, "zstd")
    bench.say("laying samples out as pictures for other codecs")
    truth = peers.Pictures(bench, lossless, "truth")
    slabs = bench.json("slf", "info", lossless, "--json")["levels"][-1]["slabs"]
    rows = _ours(bench, lossless, truth, slabs)
    step = 16 if bench.quick else 8
    rows += _picture_codecs(truth, truth.data[::step], slabs)
    rows += _exr(bench, truth, step, slabs)
    if peers.has_ffmpeg():
        rows += _jpeg_xl(bench, truth, 4 * step, slabs)
        rows += _films(bench, truth, slabs)
    else:
        part.left_out.append("JPEG XL, H.264, HEVC and AV1: ffmpeg was not found")
    part.numbers["codecs"] = rows

    fig, axis = plots.figure(width=10.5, height=4.6)
    for k, name in enumerate(dict.fromkeys(r["codec"] for r in rows if np.isfinite(r["psnr"]))):
        line = sorted((r for r in rows if r["codec"] == name), key=lambda r: r["bits"])
        line = [r for r in line if np.isfinite(r["psnr"])]
        ours = name.startswith("slf")
        axis.plot(
            [r["bits"] for r in line], [r["psnr"] for r in line], marker="o", ms=4, label=name,
            lw=2.4 if ours else 1.2, color=plots.OURS if name == "slf jpeg" else
            plots.plt.cm.Dark2(k % 8), ls="--" if r_film(name) else "-",
        )  # fmt: skip
    axis.set(xscale="log", xlabel="bits for a slab's colour", ylabel="PSNR of the samples, dB")
    axis.legend(fontsize=8.5, loc="center left", bbox_to_anchor=(1, 0.5))
    whole = [r for r in rows if not np.isfinite(r["psnr"])]
    part.add(
        page.heading("Other codecs on the same samples"),
        page.text(
            f"The brain at {shape[0] << shape[2]}/{shape[1] << shape[2]}, losslessly built, given "
            "to each codec as it likes best: ours as tiles, the others as one square picture for "
            "each entry vertex (the unfolded octahedron of exits), films as the sequence of these "
            "pictures along neighbouring vertices. Ours also stores opacity, the others do not. "
            "Films (dashed) use their neighbours, but to see one slab a whole group of pictures "
            "must be decoded."
        ),
        page.plot(plots.svg(fig)),
        page.table(
            ["lossless", "bits a slab", "against 24 bits"],
            [[r["codec"], f"{r['bits']:.2f}", f"{24 / r['bits']:.1f} : 1"] for r in whole],
        ),
    )
    _claim_codecs(part, rows)


def r_film(name):
    return name.startswith("film")


def _row(codec, setting, size, slabs, psnr):
    return {"codec": codec, "setting": setting, "bits": 8 * size / slabs, "psnr": psnr}


def _ours(bench, lossless, truth, slabs):
    def payload(field):
        return bench.json("slf", "info", field, "--json")["levels"][-1]["payload_bytes"]

    plain = bench.recoded(lossless, "zstd", depth=False)
    rows = [_row("slf zstd", "", payload(plain), slabs, float("inf"))]
    plain.unlink()
    for chroma in ("", ":444"):
        for quality in (50, 75, 90) if bench.quick else (30, 50, 75, 85, 90, 95):
            field = bench.recoded(lossless, f"jpeg:{quality}{chroma}", depth=False)
            decoded = peers.Pictures(bench, field, "ours")
            rows.append(
                _row(f"slf jpeg{' 4:4:4' if chroma else ''}", quality, payload(field), slabs,
                     _psnr(truth.data, decoded.data))
            )  # fmt: skip
            field.unlink()
    return rows


def _picture_codecs(truth, some, slabs):
    """JPEG by libjpeg and WebP, through Pillow, on evenly chosen pictures."""
    share = slabs * len(some) / truth.count
    jobs = [("JPEG (libjpeg)", "JPEG", q, {"quality": q}) for q in (30, 50, 75, 90, 95)]
    if peers.has_webp():
        jobs += [("WebP", "WEBP", q, {"quality": q, "method": 6}) for q in (30, 50, 75, 90, 95)]
        jobs += [("WebP lossless", "WEBP", "", {"lossless": True, "method": 6})]
    jobs += [("PNG", "PNG", "", {"optimize": True})]
    rows = []
    for name, kind, setting, options in jobs:
        size, decoded = peers.pillow(some, kind, **options)
        rows.append(_row(name, setting, size, share, _psnr(some, decoded)))
    return rows


def _exr(bench, truth, step, slabs):
    if not bench.program("exr_peer"):
        return []
    some = truth.data[::step]
    chosen, back = bench.work / "some.rgb", bench.work / "exr.rgb"
    some.tofile(chosen)
    rows = []
    for level in (15, 45, 150, 500, 1500):
        facts = bench.json("exr_peer", chosen, back, "--edge", truth.edge, "--level", level)
        decoded = np.fromfile(back, np.uint8).reshape(some.shape)
        share = slabs * len(some) / truth.count
        rows.append(_row("OpenEXR DWAA", level, facts["bytes"], share, _psnr(some, decoded)))
    return rows


def _jpeg_xl(bench, truth, step, slabs):
    some = truth.data[::step]
    share = slabs * len(some) / truth.count
    rows = []
    for distance in (0, 1, 2, 4) if bench.quick else (0, 0.5, 1, 2, 4, 8):
        try:
            size, decoded = peers.jpeg_xl(bench, some, distance)
        except Failed as error:  # this ffmpeg lacks the encoder
            bench.say(f"JPEG XL left out: {error}")
            break
        name = "JPEG XL" if distance else "JPEG XL lossless"
        rows.append(_row(name, distance, size, share, _psnr(some, decoded)))
    return rows


def _films(bench, truth, slabs):
    """Video codecs, applied to the sequence of pictures."""
    crf = (20, 28, 34) if bench.quick else (16, 20, 24, 28, 32, 36)
    av1 = (20, 35, 50) if bench.quick else (12, 20, 28, 36, 44, 52)
    rows = []
    for name, settings in {"H.264": crf, "HEVC": crf, "AV1": av1}.items():
        for setting in settings:
            try:
                size, decoded = peers.film(bench, truth, name, setting)
            except Failed as error:  # this ffmpeg lacks the encoder
                bench.say(f"{name} left out: {error}")
                break
            rows.append(_row(f"film, {name}", setting, size, slabs, _psnr(truth.data, decoded)))
    return rows


def _bits_at(rows, codec, psnr):
    """Bits per slab of a codec at a PSNR, interpolated between its settings; None beyond them."""
    line = sorted((r["psnr"], r["bits"]) for r in rows if r["codec"] == codec)
    if len(line) < 2 or not line[0][0] <= psnr <= line[-1][0]:
        return None
    return float(np.exp(np.interp(psnr, [p for p, _ in line], np.log([b for _, b in line]))))


def _claim_codecs(part, rows):
    middle = next(r["psnr"] for r in rows if r["codec"] == "slf jpeg" and r["setting"] == 75)
    ours = _bits_at(rows, "slf jpeg", middle)
    others = {
        name: _bits_at(rows, name, middle)
        for name in dict.fromkeys(r["codec"] for r in rows)
        if not name.startswith("slf") and "lossless" not in name and name != "PNG"
    }
    shown = {n: b / ours for n, b in others.items() if b}
    part.numbers["bits_against_ours"] = shown
    pictures = {n: f for n, f in shown.items() if not r_film(n)}
    if not pictures:
        part.claims.append(Claim("slf", "Our JPEG against other codecs", "no peer", NOT_RUN))
        return
    text = ", ".join(f"{n} {f:.2f}×" for n, f in sorted(shown.items(), key=lambda x: x[1]))
    wins = sum(f > 1 for f in pictures.values())
    part.claim(
        "slf",
        "At the same sample PSNR our JPEG tiles, opacity included, take fewer bytes than other "
        "picture codecs that decode slabs at random",
        f"{ours:.2f} bits a slab at {middle:.1f} dB; others take {text}",
        True if wins == len(pictures) else PARTLY if wins else False,
    )


def _compare_speeds(bench, part, volume, shape):
    """Ratio and speed on whole tiles, by codec_peers."""
    if not bench.program("codec_peers"):
        part.left_out.append(
            "speeds of codecs: codec_peers was not built (libwebp-dev, libpng-dev)"
        )
        return
    lossless = bench.field(volume, *shape, "zstd")
    bench.say("timing codecs on tiles")
    tiles = 64 if bench.quick else 400
    rows = bench.json("codec_peers", lossless, "--tiles", tiles, "--json")["rows"]
    part.numbers["speeds"] = rows
    part.add(
        page.heading("Speed"),
        page.folded(
            f"{len(rows)} codecs on {tiles} tiles: ratio, PSNR, encoding and decoding on one core",
            page.table(
                ["codec", "ratio", "PSNR, dB", "encode MB/s", "decode MB/s"],
                [
                    [r["codec"], f"{r['ratio']:.1f}",
                     "lossless" if r["psnr_db"] is None else f"{r['psnr_db']:.1f}",
                     f"{r['encode_mb_per_s']:.0f}", f"{r['decode_mb_per_s']:.0f}"]
                    for r in rows
                ],
            ),
        ),
    )  # fmt: skip


def _published(part):
    part.add(
        page.heading("Published figures, quoted"),
        page.table(["codec", "ratio", "PSNR of samples"], PUBLISHED,
                   "Other fields, photographed or synthetic: an orientation, not a comparison."),
    )  # fmt: skip
