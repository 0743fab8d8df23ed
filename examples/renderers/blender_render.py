"""Renders a Blender scene, or a mesh (.glb, .obj, .ply, .stl), with Cycles from the cameras of a
transforms.json, without a window:

    blender -b scene.blend --python-exit-code 1 --python blender_render.py -- transforms.json
    blender -b --python-exit-code 1 --python blender_render.py -- transforms.json model.glb 64

The last number is that of paths per pixel.

Writes the picture of each frame, 8-bit PNG with alpha, and NAME.exr with the depth Z beside it: the
distance along the camera's axis, in world units. Then states these files in transforms.json, as
depth_file_path.
"""
import os
import sys

import bpy
from mathutils import Matrix

# Blender's Python does not look beside the script.
sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import transforms  # noqa: E402

try:
    import numpy
    # The glTF importer of Blender 3.4 uses a name that NumPy 1.24 does not have.
    if not hasattr(numpy, "bool"):
        numpy.bool = bool
except ImportError:  # only that importer needs it
    pass


def load(path):
    bpy.ops.wm.read_factory_settings(use_empty=True)
    extension = path.rsplit(".", 1)[-1].lower()
    if extension in ("glb", "gltf"):
        bpy.ops.import_scene.gltf(filepath=path)
    elif extension == "obj":
        bpy.ops.wm.obj_import(filepath=path)
    elif extension == "ply":
        bpy.ops.import_mesh.ply(filepath=path)
    elif extension == "stl":
        bpy.ops.import_mesh.stl(filepath=path)
    else:
        raise SystemExit(f"{path}: expected .glb, .gltf, .obj, .ply or .stl")
    world = bpy.data.worlds.new("white from everywhere")
    bpy.context.scene.world = world
    world.use_nodes = True
    world.node_tree.nodes["Background"].inputs["Color"].default_value = (1, 1, 1, 1)


def write_depth(scene):
    scene.view_layers[0].use_pass_z = True
    scene.use_nodes = True
    tree = scene.node_tree
    layers = tree.nodes.new("CompositorNodeRLayers")
    output = tree.nodes.new("CompositorNodeOutputFile")
    output.format.file_format = "OPEN_EXR"
    output.format.color_depth = "32"
    tree.links.new(layers.outputs["Depth"], output.inputs[0])
    return output


def place(camera, lens, scene):
    scene.render.resolution_x, scene.render.resolution_y = camera.width, camera.height
    scene.render.resolution_percentage = 100
    # The sensor is as wide as the picture, in pixels. A pixel is 1 / fl_y high and 1 / fl_x wide.
    scene.render.pixel_aspect_x = max(1.0, camera.fl_y / camera.fl_x)
    scene.render.pixel_aspect_y = max(1.0, camera.fl_x / camera.fl_y)
    lens.data.sensor_fit = "HORIZONTAL"
    lens.data.sensor_width = camera.width
    lens.data.lens = camera.fl_x
    lens.data.shift_x = (camera.width / 2 - camera.cx) / camera.width
    lens.data.shift_y = (camera.cy - camera.height / 2) / camera.width
    lens.data.clip_start, lens.data.clip_end = 1e-3, 1e6
    lens.matrix_world = Matrix(camera.matrix)


def main():
    arguments = sys.argv[sys.argv.index("--") + 1:] if "--" in sys.argv else []
    if not 1 <= len(arguments) <= 3 or (len(arguments) == 3 and not arguments[2].isdecimal()):
        raise SystemExit("usage: blender ... -- TRANSFORMS.json [MODEL [PATHS]]")
    cameras = transforms.read(arguments[0])
    if len(arguments) > 1:
        load(arguments[1])
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.cycles.samples = int(arguments[2]) if len(arguments) > 2 else 64
    scene.cycles.use_denoising = False
    scene.render.film_transparent = True
    scene.view_settings.view_transform = "Standard"  # sRGB, without Blender's own tone mapping
    scene.render.image_settings.file_format = "PNG"
    scene.render.image_settings.color_mode = "RGBA"
    lens = bpy.data.objects.new("lens", bpy.data.cameras.new("lens"))
    scene.collection.objects.link(lens)
    scene.camera = lens
    depth = write_depth(scene)
    for camera in cameras:
        place(camera, lens, scene)
        folder, name = os.path.split(os.path.splitext(camera.path)[0])
        scene.render.filepath = camera.path
        depth.base_path = folder
        depth.file_slots[0].path = name + "#"
        bpy.ops.render.render(write_still=True)
        # Blender appends the number of the frame.
        os.replace(os.path.join(folder, f"{name}{scene.frame_current}.exr"),
                   os.path.join(folder, f"{name}.exr"))
    transforms.state_depths(arguments[0])


main()
