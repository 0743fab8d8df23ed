"""Figures 10 and 11: volume rendering beside the light field, turning around the object."""

from . import page
from .outcome import PARTLY, human_bytes, mean

TITLE = "Figures 10 and 11: volume rendering and light field"
WANTED = ["brain", "head", "glass", "bonsai", "atlas", "engine", "heptane", "teapot"]
SPARE = ["scalp", "regions", "monkey", "areas", "tooth"]
LEAST = 6


def run(bench, part):
    names = [n for n in WANTED if n in bench.volumes][: LEAST if bench.quick else len(WANTED)]
    names += [n for n in SPARE if n in bench.volumes][: max(0, LEAST - len(names))]
    absent = [n for n in WANTED if n not in bench.volumes]
    if absent:
        part.left_out.append(
            f"volumes that are not there: {', '.join(absent)} (--data names a folder)"
        )
    widgets, rows, numbers = [], [], {}
    for name in names:
        volume = bench.volume(name)
        field = bench.field(volume, 12, 48, 0 if bench.quick else 1)
        prefix = bench.work / f"figure10-{name}"
        bench.say(f"turning {volume.title} around")
        frames = 8 if bench.quick else 16
        views = bench.json(
            "turntable", *volume.under_direct_light(), "--field", field,
            "--frames", frames,
            "--size", 256 if bench.quick else 320, "--out", prefix,
        )  # fmt: skip
        psnr, ssim = (mean(v[key] for v in views) for key in ("psnr", "ssim"))
        size = field.stat().st_size
        numbers[name] = {"psnr": psnr, "ssim": ssim, "bytes": size, "frames": views}
        rows.append([volume.title, f"{psnr:.1f}", f"{ssim:.3f}", human_bytes(size)])
        strip = lambda kind: [f"{prefix}-{kind}-{k:02}.png" for k in range(frames)]  # noqa: E731
        widgets.append(
            page.turning(
                f"{volume.title}: {psnr:.1f} dB",
                [("volume rendering", strip("truth")), ("light field", strip("field"))],
            )
        )
    part.numbers = numbers
    part.add(
        page.text("Move over a picture to turn it. Left the truth, right the same from the field."),
        f'<div class="turnings">{"".join(widgets)}</div>',
        page.table(["volume", "PSNR, dB", "SSIM", "file"], rows),
    )
    psnr = [n["psnr"] for n in numbers.values()]
    part.claim(
        "paper, Figures 10 and 11",
        "Pictures from the light field have very little blur beside volume rendering",
        f"{len(psnr)} volumes, {mean(psnr):.1f} dB on average, {min(psnr):.1f} to {max(psnr):.1f}; "
        f"SSIM {min(n['ssim'] for n in numbers.values()):.3f} at least",
        True if min(psnr) >= 30 else PARTLY if mean(psnr) >= 28 else False,
    )
