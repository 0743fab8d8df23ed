"""Figure 8: one view by each kind of interpolation, and the error of each."""

from . import page

TITLE = "Figure 8: interpolation"
MODES = {
    "nearest": "nearest slab",
    "uv": "entry side only (uv)",
    "st": "exit side only (st)",
    "bitri": "bi-triangle",
    "depth": "depth-corrected (ours)",
}
GAIN = 4


def run(bench, part):
    volume = bench.volume("brain")
    # The paper's layout: the lattices of entry and exit are equally fine.
    levels = 2 if bench.quick else 3
    field = bench.field(volume, 8, 8, levels, "zstd")
    cells = 8 << levels
    camera = ["--orbit", "35,20,3", "--size", "384x384" if bench.quick else "512x512"]

    bench.say("drawing one view in every mode")
    truth = bench.raycast(volume, "figure8-truth", *camera)
    top, bottom = [page.Cell(truth, "ray-cast truth")], [page.Cell(None)]
    numbers = {}
    for mode, label in MODES.items():
        picture = bench.render(field, f"figure8-{mode}", "--mode", mode, *camera)
        view, error = bench.compare(truth, picture, GAIN)
        many = bench.evaluate(field, volume, mode, size=256 if bench.quick else 512)
        numbers[mode] = {"view": view, "psnr": many["psnr"], "ssim": many["ssim"]}
        top.append(page.Cell(picture, label))
        bottom.append(
            page.Cell(error, f"{view['psnr']:.1f} dB", f"SSIM {view['ssim']:.3f}; error × {GAIN}")
        )
    part.numbers = {"cells_per_edge": cells, "modes": numbers}
    part.add(
        page.text(
            f"The paper's layout, {cells} cells an edge on both sides, losslessly stored. "
            "The same samples are used in every mode; the last also uses the depth stored with "
            "each of them."
        ),
        page.grid([top, bottom]),
        page.table(
            ["mean of 8 random views", *MODES.values()],
            [
                ["PSNR, dB", *(f"{numbers[m]['psnr']:.2f}" for m in MODES)],
                ["SSIM", *(f"{numbers[m]['ssim']:.4f}" for m in MODES)],
            ],
        ),
    )

    others = [numbers[m]["psnr"] for m in ("nearest", "uv", "st")]
    best, ours = numbers["bitri"]["psnr"], numbers["depth"]["psnr"]
    part.claim(
        "paper, Figure 8",
        "Of nearest, uv-only and bi-triangle interpolation, bi-triangle is the best",
        f"{best:.1f} dB; {best - max(others):+.1f} dB over the best other, "
        f"{best - others[0]:+.1f} over nearest",
        best > max(others),
    )
    part.claim(
        "slf",
        "Correcting rays by the stored depth is sharper than bi-triangle, on the same samples",
        f"{ours:.1f} dB, {ours - best:+.1f} dB",
        ours > best,
    )
