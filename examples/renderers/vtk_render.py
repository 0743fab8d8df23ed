#!/usr/bin/env python3
"""Renders a mesh (.ply, .stl, .obj) or a volume (.vti, .nii.gz) with VTK from the cameras of a
transforms.json:

    vtk_render.py transforms.json model.ply

Writes the picture of each frame, with straight alpha. Needs python3-vtk9, and a display: without
one, start it by `xvfb-run -a python3 vtk_render.py`. The same code runs in
ParaView's pvpython. For a scene of your own, replace make_prop().
"""
import math
import sys

import transforms
import vtk


def make_prop(path):
    extension = path.rsplit(".", 1)[-1].lower()
    if extension in ("vti", "nii", "gz"):
        reader = vtk.vtkXMLImageDataReader() if extension == "vti" else vtk.vtkNIFTIImageReader()
        reader.SetFileName(path)
        reader.Update()
        low, high = reader.GetOutput().GetScalarRange()
        opacity, color = vtk.vtkPiecewiseFunction(), vtk.vtkColorTransferFunction()
        opacity.AddPoint(low + 0.3 * (high - low), 0)
        opacity.AddPoint(high, 0.8)
        color.AddRGBPoint(low, 0.6, 0.3, 0.2)
        color.AddRGBPoint(high, 1, 1, 0.9)
        mapper, prop = vtk.vtkFixedPointVolumeRayCastMapper(), vtk.vtkVolume()
        mapper.SetInputConnection(reader.GetOutputPort())
        prop.GetProperty().SetScalarOpacity(opacity)
        prop.GetProperty().SetColor(color)
        prop.GetProperty().SetInterpolationTypeToLinear()
    else:
        readers = {"ply": vtk.vtkPLYReader, "stl": vtk.vtkSTLReader, "obj": vtk.vtkOBJReader}
        if extension not in readers:
            raise SystemExit(f"{path}: expected .ply, .stl, .obj or .vti")
        reader = readers[extension]()
        reader.SetFileName(path)
        mapper, prop = vtk.vtkPolyDataMapper(), vtk.vtkActor()
        mapper.SetInputConnection(reader.GetOutputPort())
    prop.SetMapper(mapper)
    return prop


def place(camera, to):
    forward = [-v for v in camera.axis(2)]
    to.SetPosition(camera.eye)
    to.SetFocalPoint([e + f for e, f in zip(camera.eye, forward)])
    to.SetViewUp(camera.axis(1))
    # VTK knows one angle, across the height. Pixels of another shape need a transform of their own.
    to.SetViewAngle(math.degrees(2 * math.atan(camera.height / 2 / camera.fl_y)))
    if abs(camera.fl_x - camera.fl_y) > 1e-6 * camera.fl_y:
        squeeze = vtk.vtkTransform()
        squeeze.Scale(camera.fl_x / camera.fl_y, 1, 1)
        to.SetUserViewTransform(squeeze)
    to.SetWindowCenter(1 - 2 * camera.cx / camera.width, 2 * camera.cy / camera.height - 1)


def main():
    if len(sys.argv) != 3:
        raise SystemExit("usage: vtk_render.py TRANSFORMS.json MODEL")
    prop = make_prop(sys.argv[2])
    renderer, window = vtk.vtkRenderer(), vtk.vtkRenderWindow()
    renderer.AddViewProp(prop)
    renderer.SetBackground(0, 0, 0)
    renderer.SetBackgroundAlpha(0)
    window.SetOffScreenRendering(True)
    window.SetAlphaBitPlanes(True)
    window.SetMultiSamples(8)
    window.AddRenderer(renderer)
    for camera in transforms.read(sys.argv[1]):
        window.SetSize(camera.width, camera.height)
        place(camera, renderer.GetActiveCamera())
        renderer.ResetCameraClippingRange()
        window.Render()
        pixels = vtk.vtkWindowToImageFilter()
        pixels.SetInput(window)
        pixels.SetInputBufferTypeToRGBA()
        pixels.ReadFrontBufferOff()
        writer = vtk.vtkPNGWriter()
        writer.SetFileName(camera.path)
        writer.SetInputConnection(pixels.GetOutputPort())
        writer.Write()


main()
