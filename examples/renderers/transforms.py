"""Cameras of a transforms.json (instant-ngp's kind), for the scripts beside this file.

Members: fl_x, fl_y, cx, cy, w, h in pixels, for all frames or for each; of each frame, file_path
and transform_matrix, from camera to world, with x right, y up and -z forward (OpenGL's axes).
"""
import json
import os
import tempfile


def picture_of(frame):
    """The path of a frame's picture, which is a PNG."""
    stem, extension = os.path.splitext(frame["file_path"])
    if extension.lower() == ".png":
        return frame["file_path"]
    if extension.lower() in (".exr", ".jpg", ".jpeg", ".tif", ".tiff"):
        raise SystemExit(f"frame {frame['file_path']}: expected a .png, or no extension")
    return frame["file_path"] + ".png"


class Camera:
    def __init__(self, frame, common, folder):
        def number(name):
            value = frame.get(name, common.get(name))
            if value is None:
                raise SystemExit(f"frame {frame.get('file_path')}: no {name}")
            return float(value)

        self.fl_x, self.fl_y = number("fl_x"), number("fl_y")
        self.cx, self.cy = number("cx"), number("cy")
        self.width, self.height = int(number("w")), int(number("h"))
        self.matrix = frame["transform_matrix"]
        self.path = os.path.join(folder, picture_of(frame))

    def axis(self, column):
        return [self.matrix[row][column] for row in range(3)]

    @property
    def eye(self):
        return self.axis(3)


def load(path):
    try:
        with open(path, encoding="utf-8") as file:
            data = json.load(file)
    except (OSError, ValueError) as error:
        raise SystemExit(f"{path}: {error}")
    if not isinstance(data, dict) or not data.get("frames"):
        raise SystemExit(f'{path}: expected an array "frames", as `slf cameras` writes it')
    return data


def read(path):
    """The cameras of the file, whose folder the pictures' paths are relative to."""
    data = load(path)
    folder = os.path.dirname(os.path.abspath(path))
    cameras = [Camera(frame, data, folder) for frame in data["frames"]]
    for camera in cameras:
        os.makedirs(os.path.dirname(camera.path), exist_ok=True)
    return cameras


def state_depths(path):
    """Adds to each frame that its depth is in NAME.exr, beside its picture NAME.png. slf reads no
    depth that the file does not state."""
    data = load(path)
    for frame in data["frames"]:
        frame["depth_file_path"] = os.path.splitext(picture_of(frame))[0] + ".exr"
    with tempfile.NamedTemporaryFile("w", encoding="utf-8", dir=os.path.dirname(path) or ".",
                                     delete=False) as file:
        json.dump(data, file, indent=1)
        file.write("\n")
    os.chmod(file.name, os.stat(path).st_mode)
    os.replace(file.name, path)
