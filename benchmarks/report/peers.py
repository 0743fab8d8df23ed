"""Other codecs, given the colours of a field as pictures, one for each entry vertex."""

import io
import shutil

import numpy as np

FILM_GROUP = 32  # pictures that must be decoded together, at most


class Pictures:
    """The colour samples of a field as pictures, one per entry vertex."""

    def __init__(self, bench, field, name):
        self.path = bench.work / f"{name}.rgb"
        facts = bench.json("entry_pictures", field, "-o", self.path)
        self.count, self.edge = facts["pictures"], facts["edge"]
        self.data = np.fromfile(self.path, np.uint8).reshape(self.count, self.edge, self.edge, 3)


def recolored(bench, field, decoded, name):
    """The path of a field whose colours are pictures that a codec has decoded."""
    frames, path = bench.work / f"{name}.rgb", bench.work / f"{name}.slf"
    decoded.tofile(frames)
    bench.run("entry_pictures", field, "--colors", frames, "-o", path)
    frames.unlink()
    return path


# Each codec takes pictures and a setting, and returns bytes and the decoded pictures.


def pillow(pictures, kind, **options):
    """JPEG by libjpeg, WebP and PNG."""
    from PIL import Image

    size, back = 0, np.empty_like(pictures)
    for k, picture in enumerate(pictures):
        buffer = io.BytesIO()
        Image.fromarray(picture).save(buffer, kind, **options)
        size += buffer.tell()
        back[k] = np.asarray(Image.open(buffer).convert("RGB"))
    return size, back


def has_webp():
    from PIL import features

    return features.check("webp")


FILMS = {
    "H.264": ("h264", ["-c:v", "libx264", "-preset", "medium"]),
    "HEVC": ("hevc", ["-c:v", "libx265", "-preset", "medium", "-x265-params", "log-level=error"]),
    "AV1": ("ivf", ["-c:v", "libsvtav1", "-preset", "8"]),
}


def has_ffmpeg():
    return bool(shutil.which("ffmpeg"))


_SAY = ["-hide_banner", "-loglevel", "error", "-y"]
_RAW = ["-f", "rawvideo", "-pix_fmt", "rgb24"]


def jpeg_xl(bench, pictures, distance):
    """Codes each picture by itself; lossless at distance 0. Raises bench.Failed without libjxl."""
    folder, source, out = bench.work / "jxl", bench.work / "some.rgb", bench.work / "back.rgb"
    folder.mkdir(exist_ok=True)
    pictures.tofile(source)
    edge = pictures.shape[1]
    bench.say(f"JPEG XL, distance {distance}")
    bench.run("ffmpeg", *_SAY, *_RAW, "-s", f"{edge}x{edge}", "-i", source, "-c:v", "libjxl",
              "-distance", distance, "-effort", 7, folder / "%05d.jxl")  # fmt: skip
    size = sum(path.stat().st_size for path in folder.iterdir())
    bench.run("ffmpeg", *_SAY, "-i", folder / "%05d.jxl", *_RAW, out)
    back = np.fromfile(out, np.uint8).reshape(pictures.shape)
    shutil.rmtree(folder)
    source.unlink(), out.unlink()
    return size, back


def film(bench, truth, name, crf):
    """Codes all pictures as a film. Raises bench.Failed if this ffmpeg lacks the encoder."""
    end, codec = FILMS[name]
    edge = truth.edge
    even = edge + edge % 2
    path, out = bench.work / f"film.{end}", bench.work / "film.rgb"
    bench.say(f"film, {name}, crf {crf}")
    bench.run("ffmpeg", *_SAY, *_RAW, "-s", f"{edge}x{edge}", "-r", 30, "-i", truth.path,
              "-vf", f"pad={even}:{even}:0:0", *codec, "-g", FILM_GROUP, "-pix_fmt", "yuv420p",
              "-crf", crf, path)  # fmt: skip
    bench.run("ffmpeg", *_SAY, "-i", path, *_RAW, out)
    back = np.fromfile(out, np.uint8).reshape(truth.count, even, even, 3)[:, :edge, :edge]
    out.unlink()
    return path.stat().st_size, np.ascontiguousarray(back)
