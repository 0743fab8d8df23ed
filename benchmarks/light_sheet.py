#!/usr/bin/env python3
"""Makes a contact sheet of volumes under rigs of lights: a row for each volume, a column per rig.

  benchmarks/light_sheet.py --slf build/release/cli/slf -o sheet.jpg [--samples 32] [--size 384]
      VOLUME[:TRANSFER[:OPTIONS]] ...

Without volumes it draws those in ../shared/data. The first column shows direct light. Pictures that
exist in the folder are not drawn again. Needs ImageMagick's montage.
"""

import argparse
import pathlib
import subprocess

DATA = pathlib.Path(__file__).resolve().parents[2] / "shared/data"
FONT = "/usr/share/fonts/truetype/dejavu/DejaVuSans.ttf"
# The patient's face, without the head rest: these voxels run from front to back.
FACE = "--crop 35:220,45:256,: --orbit 205,12,2.6"
VOLUMES = [
    "/usr/share/mricron/templates/ch2bet.nii.gz:scripts/data/brain.json",
    "/usr/share/mricron/templates/ch2bet.nii.gz:scripts/data/brain_translucent.json",
    f"{DATA}/cranium_ct/cranium_ct_256x256x108_int16.nrrd:ct-bone:{FACE}",
    f"{DATA}/cranium_ct/cranium_ct_256x256x108_int16.nrrd:ct-skin:{FACE}",
    f"{DATA}/bonsai_ct/bonsai.nii.gz:{DATA}/transfer/bonsai.json",
    f"{DATA}/engine_ct/engine.nii.gz:{DATA}/transfer/engine.json",
    f"{DATA}/boston_teapot_ct/boston_teapot_256x256x178_uint8.nrrd:micro-ct",
    f"{DATA}/acrolein_density_sim/acrolein_scf_density_77x69x96_float32.nrrd",
    f"{DATA}/tooth_ct/tooth.nhdr",
]


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--slf", required=True)
    parser.add_argument("-o", "--output", required=True)
    parser.add_argument("--folder", default="out/light_sheet", help="where single pictures are kept")
    parser.add_argument("--rigs", default="direct,studio,rim,overcast")
    parser.add_argument("--samples", default="32")
    parser.add_argument("--spacing", default="1")
    parser.add_argument("--size", default="384")
    parser.add_argument("--orbit", default="30,20,3")
    parser.add_argument("volumes", nargs="*", default=VOLUMES)
    a = parser.parse_args()
    folder = pathlib.Path(a.folder)
    folder.mkdir(parents=True, exist_ok=True)
    rigs = a.rigs.split(",")
    tiles = []
    for item in a.volumes:
        volume, transfer, options = (item.split(":", 2) + ["", ""])[:3]
        if not pathlib.Path(volume).exists():
            print(f"{volume}: not there, left out")
            continue
        stem = pathlib.Path(volume).name.split(".")[0]
        stem += "-" + pathlib.Path(transfer).stem if transfer else ""
        for rig in rigs:
            picture = folder / f"{stem}-{rig}.png"
            tiles += ["-label", f"{stem}, {rig}", str(picture)]
            if picture.exists():
                continue
            light = ["--lighting", "direct"]
            if rig != "direct":
                light = ["--lighting", "global", "--light-rig", rig, "--light-samples", a.samples,
                         "--light-spacing", a.spacing]
            subprocess.run(
                [a.slf, "-q", "raycast", volume, "-o", str(picture), "--size", a.size]
                + ([] if "--orbit" in options else ["--orbit", a.orbit])
                + (["--transfer", transfer] if transfer else [])
                + options.split() + light,
                check=True)
    subprocess.run(["montage", "-font", FONT, *tiles, "-tile", f"{len(rigs)}x", "-geometry", "+4+4",
                    "-background", "black", "-fill", "white", "-quality", "90", a.output],
                   check=True)


if __name__ == "__main__":
    main()
