#!/usr/bin/env python3
"""Makes a contact sheet of volumes under rigs of lights: a row for each volume, a column per rig.

  benchmarks/light_sheet.py --slf build/release/cli/slf -o sheet.jpg [--samples 32] [--size 384]
      [TITLE=]VOLUME[:TRANSFER[:OPTIONS]] ...

Without volumes it draws those in the folder --data. The rig `direct` is direct light; `paths` is
the studio by path tracing, with --paths paths a ray, beside which light volumes are judged. Pictures
that exist in the folder are not drawn again. Needs ImageMagick's montage.
"""

import argparse
import pathlib
import subprocess

FONT = "/usr/share/fonts/truetype/dejavu/DejaVuSans.ttf"
ROOT = pathlib.Path(__file__).resolve().parents[1]
BRAIN = "/usr/share/mricron/templates/ch2bet.nii.gz"
# The patient's face, without the head rest. These voxels run from front to back, so rigs shine on
# the back of the head; direct light is turned.
FACE = "--crop 35:220,45:256,: --orbit 205,12,2.6 --light=0.5,0.7,0.6"


def volumes_in(data):
    head = f"{data}/cranium_ct/cranium_ct_256x256x108_int16.nrrd"
    return [
        f"Brain, MRI={BRAIN}:{ROOT}/scripts/data/brain.json",
        f"Brain, translucent={BRAIN}:{ROOT}/scripts/data/brain_translucent.json",
        f"Head, CT: bone={head}:ct-bone:{FACE}",
        f"Head, CT: skin={head}:ct-skin:{FACE}",
        f"Bonsai, CT={data}/bonsai_ct/bonsai.nii.gz:{data}/transfer/bonsai.json",
        f"Engine block, CT={data}/engine_ct/engine.nii.gz:{data}/transfer/engine.json",
        f"Teapot, CT={data}/boston_teapot_ct/boston_teapot_256x256x178_uint8.nrrd:micro-ct",
        f"Acrolein, electron density={data}/acrolein_density_sim/"
        "acrolein_scf_density_77x69x96_float32.nrrd:cryo-em:--range 0,0.02",
        f"Tooth, CT={data}/tooth_ct/tooth.nhdr",
    ]


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--slf", required=True)
    parser.add_argument("-o", "--output", required=True)
    parser.add_argument("--folder", default="out/light_sheet",
                        help="where single pictures are kept")
    parser.add_argument("--rigs", default="direct,studio,paths")
    parser.add_argument("--samples", default="16")
    parser.add_argument("--spacing", default="2")
    parser.add_argument("--paths", default="64")
    parser.add_argument("--size", default="384")
    parser.add_argument("--orbit", default="30,20,3")
    parser.add_argument("--data", default=ROOT.parent / "shared/data", help="volumes")
    parser.add_argument("volumes", nargs="*")
    a = parser.parse_args()
    folder = pathlib.Path(a.folder)
    folder.mkdir(parents=True, exist_ok=True)
    rigs = a.rigs.split(",")
    tiles = []
    for item in a.volumes or volumes_in(a.data):
        title, source = item.split("=", 1) if "=" in item else ("", item)
        volume, transfer, options = (source.split(":", 2) + ["", ""])[:3]
        if not pathlib.Path(volume).exists():
            print(f"{volume}: not there, left out")
            continue
        stem = pathlib.Path(volume).name.split(".")[0]
        stem += "-" + pathlib.Path(transfer).stem if transfer else ""
        title = title or stem
        for rig in rigs:
            picture = folder / f"{stem}-{rig}.png"
            tiles += ["-label", f"{title} – {rig}", str(picture)]
            if picture.exists():
                continue
            light = ["--lighting", "direct"]
            more = options.split()
            if rig != "direct":
                more = [option for option in more if not option.startswith("--light=")]
                light = ["--lighting", "global"]
                light += (["--reference", "--samples", a.paths] if rig == "paths" else
                          ["--light-rig", rig, "--light-samples", a.samples,
                           "--light-spacing", a.spacing])
            subprocess.run(
                [a.slf, "-q", "raycast", volume, "-o", str(picture), "--size", a.size]
                + ([] if "--orbit" in options else ["--orbit", a.orbit])
                + (["--transfer", transfer] if transfer else [])
                + more + light,
                check=True)
    subprocess.run(["montage", "-font", FONT, *tiles, "-tile", f"{len(rigs)}x", "-geometry", "+4+4",
                    "-background", "black", "-fill", "white", "-quality", "90", a.output],
                   check=True)


if __name__ == "__main__":
    main()
