// Files and folders that are not read are refused by the name of their format.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/source/volume/samples.h"

namespace slf {
namespace {

using namespace samples;
using ::testing::HasSubstr;

struct Sample {
  const char* file;
  std::string start;
  const char* format;
  const char* way = "";
};

std::string at(std::size_t offset, const std::string& bytes) {
  return std::string(offset, '\0') + bytes;
}

std::vector<Sample> samples_of_formats() {
  const std::string hdf5 = "\x89HDF\r\n\x1a\n";
  const std::string ole = "\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1";
  return {
      {"a.mnc", "CDF\1....", "MINC 1", "mnc2nii"},
      {"a", std::string("CDF\2....MINC standard variable"), "MINC 1", "mnc2nii"},
      {"a.mnc", hdf5, "MINC 2", "mnc2nii"},
      {"a.h5", hdf5, "HDF5", "h5py"},
      {"a.ims", hdf5, "Imaris", "bfconvert"},
      {"a.nc", hdf5, "NetCDF 4"},
      {"a.nc", "CDF\5....", "NetCDF"},
      {"a.mat", at(0, "MATLAB 7.3 MAT-file") + std::string(493, ' ') + hdf5, "MATLAB 7.3"},
      {"a.mat", "MATLAB 5.0 MAT-file, Platform", "MATLAB"},
      {"a.PAR", "# === DATA DESCRIPTION FILE ======", "PAR/REC", "parrec2nii"},
      {"a.HEAD", "\ntype  = string-attribute\nname = X\n", "AFNI", "3dAFNItoNIFTI"},
      {"a.fits", "SIMPLE  =                    T", "FITS", "astropy"},
      {"a.czi", "ZISRAWFILE", "CZI", "bfconvert"},
      {"a.nd2", "\xda\xce\xbe\x0a", "ND2", "bfconvert"},
      {"a.lif", std::string("\x70\0\0\0\x10\0\0\0*\x08", 10), "LIF", "bfconvert"},
      {"a.oib", ole, "OLE"},
      {"a.dm4", std::string("\0\0\0\4\0\0\0\0\0\1", 10), "DM4"},
      {"a.vdb", std::string(" BDV\0\0\0\0", 8), "OpenVDB"},
      {"a.mif", "mrtrix image\ndim: 3", "MRtrix", "mrconvert"},
      {"a.am", "# AmiraMesh BINARY", "Amira"},
      {"a.pvm", "PVM2\n", "PVM"},
      {"a.pvd", "<?xml version=\"1.0\"?>\n<VTKFile type=\"Collection\"></VTKFile>",
       "give one of the files that it lists"},
      {"a.vtu", "<?xml version=\"1.0\"?>\n<VTKFile type=\"UnstructuredGrid\"></VTKFile>",
       "a VTK file of 'UnstructuredGrid'", "resample"},
      {"a.vtp", "<VTKFile type=\"PolyData\"></VTKFile>", "a VTK file of 'PolyData'"},
      {"a.mha", "ObjectType = Mesh\nNDims = 3\n", "a MetaIO 'Mesh'"},
      {"a.gii", "<?xml version=\"1.0\"?><GIFTI Version=\"1.0\">", "GIFTI"},
      {"a.stl", "solid cube\nfacet", "STL"},
      {"b.stl", std::string(80, ' ') + "\14", "STL"},
      {"a.ply", "ply\nformat ascii", "PLY"},
      {"a.obj", "v 0 0 0\n", "OBJ"},
      {"a.glb", "glTF\2", "glTF"},
      {"a.gltf", "{\"asset\": {\"version\": \"2.0\"}}", "glTF"},
      {"a.json", "{\"frames\": []}", "a file of cameras", "pictures:"},
      {"a.off", "OFF\n8 12 0\n", "OFF", "MeshLab"},
      {"a.off", "COFF\n8 12 0\n", "OFF", "MeshLab"},
      {"a.wrl", "#VRML V2.0 utf8\n", "VRML", "MeshLab"},
      {"a.step", "ISO-10303-21;\nHEADER;", "STEP", "FreeCAD"},
      {"a.usda", "#usda 1.0\n", "USD", "Blender"},
      {"a.usdc", "PXR-USDC", "USD", "Blender"},
      {"a.usdz", "PK\3\4", "USD", "Blender"},
      {"a.3mf", "PK\3\4", "3MF", "MeshLab"},
      {"a.amf", "<?xml version=\"1.0\"?><amf unit=\"mm\">", "AMF", "MeshLab"},
      {"a.dae", "<?xml version=\"1.0\"?>\n<COLLADA>", "COLLADA", "Blender"},
      {"a.x3d", "<?xml version=\"1.0\"?>\n<X3D>", "X3D", "Blender"},
      {"a.fbx", "Kaydara FBX Binary", "FBX", "Blender"},
      {"a.fbx", "; FBX 7.3.0 project file\n", "FBX", "Blender"},
      {"a.splat", "\1\2\3", "Gaussian splats"},
      {"sfm_data.json", "{\"sfm_data_version\": \"0.3\", \"views\": []}", "OpenMVG", "COLMAP"},
      {"cameras.sfm", "{\"version\": [1], \"views\": []}", "Meshroom", "COLMAP"},
      {"cameras.xml", "<?xml version=\"1.0\"?>\n<document version=\"1.5.0\">", "Metashape",
       "COLMAP"},
      {"bundle.out", "# Bundle file v0.3\n", "Bundler", "COLMAP"},
      {"a.3dm", "3D Geometry File Format        4", "Rhino", "FreeCAD"},
      {"a.dxf", "  0\r\nSECTION\r\n  2\r\n", "DXF"},
      {"a.msh", "$MeshFormat\n2.2 0 8\n", "Gmsh", "Blender"},
      {"a.pcd", "# .PCD v0.7\n", "PCD", "make a mesh"},
      {"a.laz", "LASF", "LAS", "make a mesh"},
      {"a.vox", "VOX \x96", "MagicaVoxel"},
      {"a.isq", "CTDATA-HEADER_V1", "Scanco"},
      {"cam.nvm", "NVM_V3\n", "VisualSFM", "COLMAP"},
      {"reconstruction.json", R"([{"cameras": {}, "shots": {}}])", "OpenSfM", "COLMAP"},
      {"cameras.json", R"([{"id": 0, "img_name": "a"}])", "Gaussian splats", "COLMAP"},
      {"cameras.csv", "#name,x,y,alt,heading\n", "RealityCapture", "COLMAP"},
      {"a.zip", "PK\3\4", "ZIP"},
      {"a.tar", at(257, "ustar"), "tar", "unpack"},
      {"a.7z", "7z\xbc\xaf\x27\x1c", "7-Zip"},
      {"a.pdf", "%PDF-1.7", "PDF"},
      {"a.png", "\x89PNG\r\n\x1a\n", "one picture", "folder"},
      {"a.jpg", "\xff\xd8\xff\xe0", "picture", "folder"},
      {"a.gif", "GIF89a", "GIF picture"},
      {"a.webp", "RIFF....WEBP", "WebP picture"},
      {"a.jp2", std::string("\0\0\0\x0cjP  \r\n", 10), "JPEG 2000"},
      {"a.hdr", "#?RADIANCE\n", "Radiance picture"},
      {"a.bmp", "BM....", "BMP picture"},
      {"a.webm", "\x1a\x45\xdf\xa3", "WebM"},
      {"a.mp4",
       std::string("\0\0\0\x18"
                   "ftypisom",
                   12),
       "MP4"},
      {"a.nii.gz", "<!DOCTYPE html>\n<html>", "web page", "download"},
      {"a.nii.gz", "version https://git-lfs.github.com/spec/v1\n", "Git LFS", "git lfs pull"},
      {"a.slf", at(16, "\xde\xc0\xef\xbe"), "light field"},
      {"a.xml", "<?xml version=\"1.0\"?><data/>", "XML document"},
      {"bom.dae", "\xEF\xBB\xBF<?xml version=\"1.0\"?>\n<COLLADA>", "COLLADA", "Blender"},
      {"bom.wrl", "\xEF\xBB\xBF\n#VRML V2.0 utf8\n", "VRML", "MeshLab"},
      {"b.dxf", "0\nSECTION\n2\n", "DXF"},
      {"c.dxf", "AutoCAD Binary DXF\r\n", "DXF"},
      {"a.dwg", "AC1032", "DWG"},
      {"a.ma", "//Maya ASCII 2024 scene\n", "Maya"},
      {"a.mb", "FOR4....MAYA", "Maya"},
      {"a.lwo", "FORM....LWO2", "LightWave"},
      {"a.x3dv", "#X3D V3.3 utf8\n", "X3D"},
      {"a.xyz", "0 0 0\n", "point cloud", "make a mesh"},
      {"a.mg", "{\"header\": {}}", "Meshroom", "COLMAP"},
      {"reconstruction.json", R"([{"reference_lla": {}}])", "OpenSfM", "COLMAP"},
      {"blocks.xml", "<?xml version=\"1.0\"?><BlocksExchange>", "ContextCapture", "COLMAP"},
      {"cameras.csv", "#cameras 2\n", "RealityCapture", "COLMAP"},
  };
}

TEST(VolumeKnownFormats, AreNamedWithAWayToConvertThem) {
  for (const auto& sample : samples_of_formats()) {
    const Folder folder;
    const auto path = folder.write(sample.file, sample.start);
    expect_error(path, ErrorCode::unsupported, sample.format);
    expect_error(path, ErrorCode::unsupported, sample.way);
    // Packed, too.
    expect_error(folder.write(std::string(sample.file) + ".gz", gzip(sample.start)),
                 ErrorCode::unsupported, sample.format);
  }
}

TEST(VolumeKnownFormats, VoxelsBesideTheirHeader) {
  const Folder folder;
  folder.write("a.HEAD", "");
  folder.write("b.PAR", "");
  expect_error(folder.write("a.BRIK", "voxels"), ErrorCode::unsupported, "a file of AFNI voxels");
  expect_error(folder.write("b.REC", "voxels"), ErrorCode::unsupported,
               "a file of Philips PAR/REC voxels");
}

TEST(VolumeKnownFormats, WhatIsNotKnownMayBeRaw) {
  const Folder folder;
  expect_error(folder.write("a.den", "voxels"), ErrorCode::usage, "'voxels' at its start");
  expect_error(folder.write("a.den.gz", gzip("voxels")), ErrorCode::usage,
               "'voxels' at its start, unpacked from gzip");
}

TEST(VolumeKnownFormats, FoldersAreNamedByWhatIsInThem) {
  const Folder zarr, movies, texts, volumes, empty, nested;
  zarr.write(".zgroup", "{}");
  expect_error(zarr.path(), ErrorCode::unsupported, "a Zarr folder");
  movies.write("a.gif", "GIF89a");
  movies.write("b.gif", "GIF89a");
  movies.write("c.pdf", "%PDF-1.7");
  expect_error(
      movies.path(), ErrorCode::bad_file,
      "among its 3 files is no DICOM picture, PNG, JPEG or TIFF (2 times a GIF picture, once a "
      "PDF document)");
  texts.write("readme", "text");
  expect_error(texts.path(), ErrorCode::bad_file,
               "among its 1 files is no DICOM picture, PNG, JPEG or TIFF:");
  volumes.write("b.nii.gz", gzip(nifti({})));
  volumes.write("a.txt", "text");
  expect_error(volumes.path(), ErrorCode::unsupported, "such as " + volumes.path("b.nii.gz"));
  expect_error(empty.path(), ErrorCode::bad_file, "holds no files");
  nested.write("series/1.dcm", dicom({}));
  expect_error(nested.path(), ErrorCode::bad_file, "holds no files, only folders");
}

}  // namespace
}  // namespace slf
