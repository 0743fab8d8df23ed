"""Cameras of a transforms.json (instant-ngp's kind), for the scripts beside this file.

Members: fl_x, fl_y, cx, cy, w, h in pixels, for all frames or for each; of each frame, file_path
and transform_matrix, from camera to world, with x right, y up and -z forward (OpenGL's axes).
"""
import json
import os


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
        path = frame["file_path"]
        if not path.lower().endswith((".png", ".exr")):
            path += ".png"
        self.path = os.path.join(folder, path)

    def axis(self, column):
        return [self.matrix[row][column] for row in range(3)]

    @property
    def eye(self):
        return self.axis(3)


def read(path):
    """The cameras of the file, whose folder the pictures' paths are relative to."""
    with open(path) as file:
        data = json.load(file)
    folder = os.path.dirname(os.path.abspath(path))
    cameras = [Camera(frame, data, folder) for frame in data["frames"]]
    for camera in cameras:
        os.makedirs(os.path.dirname(camera.path), exist_ok=True)
    return cameras
