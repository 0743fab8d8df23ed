#include "source/volume/formats.h"

#include <algorithm>
#include <array>
#include <filesystem>
#include <map>

namespace slf::volume_io {

const std::vector<VolumeFormat>& volume_formats() {
  constexpr bool kUnpacksItself = true, kNamesArrays = true;
  // clang-format off
  static const std::vector<VolumeFormat> kFormats = {
      {"NRRD", looks_like_nrrd, read_nrrd, {{".nrrd", "'NRRD000'"}, {".nhdr", "'NRRD000'"}},
       false, false, nrrd_names_files},
      {"NIfTI, Analyze", looks_like_nifti, read_nifti,
       {{".nii", "a NIfTI header ('n+1' at byte 344 or 'n+2' at byte 4)"},
        {".hdr", "a header of NIfTI ('ni1' at byte 344) or Analyze (348 bytes)"}}, kUnpacksItself},
      {"MetaImage", looks_like_meta, read_meta,
       {{".mha", "'ObjectType = Image'"}, {".mhd", "'ObjectType = Image'"}},
       false, false, meta_names_files},
      {"", looks_like_dicom, read_dicom_file, {{".dcm", "'DICM' at byte 128"}}, kUnpacksItself},
      {"TIFF", looks_like_tiff, read_tiff,
       {{".tif", "a TIFF header ('II*' or 'MM')"}, {".tiff", "a TIFF header ('II*' or 'MM')"}},
       false, kNamesArrays},
      {"MRC", looks_like_mrc, read_mrc, {{".mrc", "an MRC header ('MAP' at byte 208)"}},
       kUnpacksItself},
      {"VTI", looks_like_vti, read_vti, {{".vti", "'<VTKFile type=\"ImageData\"'"}},
       false, kNamesArrays},
      {"NumPy", looks_like_npy, read_npy, {{".npy", "'\\x93NUMPY'"}}, kUnpacksItself},
      {"", looks_like_npz, read_npz, {{".npz", "a ZIP file ('PK') of arrays"}},
       false, kNamesArrays},
      {"MGH", looks_like_mgh, read_mgh,
       {{".mgh", "an MGH header (version 1, big endian)"},
        {".mgz", "an MGH header (version 1, big endian) in gzip"}}, kUnpacksItself},
      {"VTK", looks_like_vtk, read_vtk, {{".vtk", "'# vtk DataFile Version'"}},
       false, kNamesArrays}};
  // clang-format on
  return kFormats;
}

const VolumeFormat* format_of(std::string_view head) {
  for (const VolumeFormat& format : volume_formats())
    if (format.looks_like(head)) return &format;
  return nullptr;
}

namespace {

using namespace std::string_view_literals;
namespace fs = std::filesystem;

/// A format that is not read. In `way`, IN and OUT stand for the files.
struct Known {
  std::string_view name;
  std::string_view way;
};

constexpr auto kOneArray = "save its array as .npy (numpy.save)"sv;
constexpr auto kGrid = "copy its grid to an array, and save that as .npy (numpy.save)"sv;
constexpr auto kPvm = "convert it to raw voxels, `pvm2raw IN OUT`"sv;
constexpr auto kAsOmeTiff = "convert it, `bfconvert IN OUT.ome.tiff` (Bio-Formats)"sv;
constexpr auto kOnePicture =
    "a volume is a stack of pictures: give the folder that holds them all, as PNG, JPEG or TIFF"sv;
constexpr auto kFilm = "save its frames as PNGs in a folder, `ffmpeg -i IN FOLDER/%04d.png`"sv;
constexpr auto kOtherMesh = "convert it to PLY, OBJ or glTF, e.g. with MeshLab or Blender"sv;
constexpr auto kSolid = "convert it to STL or glTF, e.g. with FreeCAD"sv;
constexpr auto kPoints = "points have no surface; make a mesh of them, e.g. with MeshLab"sv;
constexpr auto kRig =
    "export its cameras for COLMAP or as transforms.json (nerfstudio's ns-process-data)"sv;
constexpr auto kMesh = "a mesh has surfaces and no voxels; give the volume that it was made from"sv;
constexpr auto kArchive = "unpack it, and give the file or the folder in it"sv;
struct Magic {
  std::size_t at;
  std::string_view bytes, name, way;
};

/// By bytes at a fixed place. Longer ones stand before those that they begin with.
constexpr Magic kMagics[] = {
    {0, "SIMPLE  =", "a FITS image", "save its array as .npy, with astropy.io.fits"},
    {0, "\nmnc", "a MINC volume", "convert it to NIfTI, `mnc2nii IN OUT.nii`"},
    {0, "MATLAB 5.0 MAT-file", "a MATLAB file",
     "save its array as NIfTI (niftiwrite) or .npy (scipy.io.loadmat)"},
    {0, "# === DATA DESCRIPTION FILE", "a Philips PAR/REC header",
     "convert it to NIfTI, `dcm2niix IN` or `parrec2nii IN`"},
    {0, "mrtrix image", "an MRtrix image", "convert it, `mrconvert IN OUT.nii`"},
    {0, "mrtrix tracks", "a tractogram (MRtrix)", "it holds curves and no voxels"},
    {0, "TRACK\0"sv, "a tractogram (TrackVis)", "it holds curves and no voxels"},
    {0, "!INTERFILE", "an Interfile header", "convert it to NIfTI, with (X)MedCon"},
    {0, "MATRIX7", "an ECAT 7 volume", "convert it to NIfTI, with nibabel"},
    {0, "#INRIMAGE-4#", "an Inrimage volume", kOneArray},
    {0, "ENVI\r", "an ENVI header", kOneArray},
    {0, "ENVI\n", "an ENVI header", kOneArray},
    {0, "# AmiraMesh", "an Amira file", "save it as NRRD or TIFF in Amira or Avizo"},
    {0, "# Avizo", "an Avizo file", "save it as NRRD or TIFF in Amira or Avizo"},
    {0, "PVM\n", "a PVM volume", kPvm},
    {0, "PVM2\n", "a PVM volume", kPvm},
    {0, "PVM3\n", "a PVM volume", kPvm},
    {0, "DDS v3", "a packed PVM volume", kPvm},
    {0, "ncaa\n", "a VFF volume", kOneArray},
    {0, " BDV\0\0\0\0"sv, "an OpenVDB file", kGrid},
    {0, "NanoVDB", "a NanoVDB file", kGrid},
    {0, "ZISRAWFILE", "a Zeiss CZI file", kAsOmeTiff},
    {0, "\xda\xce\xbe\x0a", "a Nikon ND2 file", kAsOmeTiff},
    {0, "\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1",
     "an OLE compound file (such as Olympus OIB or Zeiss ZVI)", kAsOmeTiff},
    {0, "\0\0\0\3\0\0\0"sv, "a Gatan DM3 file", "save it as MRC or TIFF"},
    {0, "\0\0\0\4\0\0\0\0"sv, "a Gatan DM4 file", "save it as MRC or TIFF"},
    {0, "\xff\xff\xfe", "a FreeSurfer surface", "convert it, `mris_convert IN OUT.stl`"},
    {0, "glTF", "a glTF scene", kMesh},
    {0, "ply\n", "a PLY mesh", kMesh},
    {0, "ply\r", "a PLY mesh", kMesh},
    {0, "solid ", "an STL mesh", kMesh},
    {0, "Kaydara FBX", "an FBX scene", kOtherMesh},
    {0, "; FBX", "an FBX scene", kOtherMesh},
    {0, "BLENDER", "a Blender file", "export it as glTF in Blender"},
    {0, "#VRML", "a VRML scene", kOtherMesh},
    {0, "PXR-USDC", "a USD scene", kOtherMesh},
    {0, "#usda", "a USD scene", kOtherMesh},
    {0, "xof 0", "a DirectX mesh", kOtherMesh},
    {0, "OCTM", "an OpenCTM mesh", kOtherMesh},
    {0, "DRACO", "a Draco mesh", kOtherMesh},
    {0, "Ogawa", "an Alembic scene", kOtherMesh},
    {0, "ISO-10303-21", "a STEP model", kSolid},
    {0, "3D Geometry File Format", "a Rhino model", kSolid},
    {0, "0\nSECTION", "a DXF drawing", kSolid},
    {0, "0\r\nSECTION", "a DXF drawing", kSolid},
    {0, "AutoCAD Binary DXF", "a DXF drawing", kSolid},
    {0, "AC10", "a DWG drawing", kSolid},
    {0, "DBRep_DrawableShape", "a BREP model", kSolid},
    {0, "U3D\0"sv, "a U3D scene", kOtherMesh},
    {0, "\xff\xfe\xff\x0eS\0k\0e\0"sv, "a SketchUp model", "export it as glTF in SketchUp"},
    {0, "QC4DC4D6", "a Cinema 4D scene", "export it as glTF in Cinema 4D"},
    {0, "//Maya ASCII", "a Maya scene", "export it as OBJ in Maya"},
    {8, "MAYA", "a Maya scene", "export it as OBJ in Maya"},
    {8, "LWO", "a LightWave object", kOtherMesh},
    {0, "#X3D", "an X3D scene", kOtherMesh},
    {0, "#Inventor", "an Open Inventor scene", kOtherMesh},
    {0, "$MeshFormat", "a Gmsh mesh", kOtherMesh},
    {0, "MeshVersionFormatted", "a Medit mesh", kOtherMesh},
    {0, "# .PCD", "a PCD point cloud", kPoints},
    {0, "LASF", "a LAS point cloud", kPoints},
    {0, "ASTM-E57", "an E57 point cloud", kPoints},
    {0, "VOX ", "a MagicaVoxel model", "export it as PLY or OBJ in MagicaVoxel"},
    {0, "CTDATA-HEADER", "a Scanco ISQ volume", "convert it to DICOM or MetaImage, e.g. with ITK"},
    {0, "NVM_V3", "a file of cameras of VisualSFM", kRig},
    {0, "# Bundle file", "a file of cameras of Bundler", kRig},
    {0, "GIF8", "a GIF picture", kOnePicture},
    {8, "WEBP", "a WebP picture", kOnePicture},
    {0, "\x76\x2f\x31\x01", "an OpenEXR picture", kOnePicture},
    {0, "#?RADIANCE", "a Radiance picture", kOnePicture},
    {0, "\0\0\0\x0cjP  "sv, "a JPEG 2000 picture", kOnePicture},
    {0, "\xff\x4f\xff\x51", "a JPEG 2000 picture", kOnePicture},
    {0, "\x1a\x45\xdf\xa3", "a WebM or Matroska film", kFilm},
    {4, "ftyp", "an MP4 film or HEIF picture", kFilm},
    {8, "AVI ", "an AVI film", kFilm},
    {257, "ustar", "a tar archive", kArchive},
    {0, "7z\xbc\xaf\x27\x1c", "a 7-Zip archive", kArchive},
    {0, "Rar!\x1a\x07", "a RAR archive", kArchive},
    {0, "PK\3\4", "a ZIP archive", kArchive},
    {0, "\x04\x22\x4d\x18", "a file packed by lz4", "unpack it, `lz4 -d IN OUT`"},
    {0, "\x1f\x9d", "a file packed by compress", "unpack it, `gunzip IN`"},
    {16, "\xde\xc0\xef\xbe", "a light field, or another LMDB file",
     "give the volume that it was built from"},
    {0, "%PDF-", "a PDF document", "give the volume itself"},
    {0, "SQLite format 3", "an SQLite database", "give the volume itself"},
    {0, "version https://git-lfs", "a pointer of Git LFS", "fetch the file itself, `git lfs pull`"},
    {0, "/annex/objects/", "a pointer of git-annex", "fetch the file itself, `git annex get IN`"},
};

/// By their beginning in small letters, without blanks, by what it holds, and by the file's name.
/// Only names tell some apart, such as archives.
struct Text {
  std::string_view begins, holds, ending;
  Known known;
};
constexpr auto kPage =
    "the download brought a page instead of the file; download it again, in a browser"sv;
constexpr auto kCameras = "name it pictures:IN, for the pictures that it lists"sv;
constexpr Text kTexts[] = {
    {"<!doctype html", "", "", {"a web page", kPage}},
    {"<html", "", "", {"a web page", kPage}},
    {"type", "-attribute", "", {"an AFNI header", "convert it to NIfTI, `3dAFNItoNIFTI IN`"}},
    {"<", "<gifti", "", {"a GIFTI surface", "convert it to STL, `mris_convert IN OUT.stl`"}},
    {"<", "<collada", "", {"a COLLADA scene", kOtherMesh}},
    {"<", "<x3d", "", {"an X3D scene", kOtherMesh}},
    {"<", "<amf", "", {"an AMF model", kOtherMesh}},
    {"pk\3\4", "", ".3mf", {"a 3MF model", kOtherMesh}},
    {"pk\3\4", "", ".amf", {"an AMF model", kOtherMesh}},
    {"pk\3\4", "", ".usdz", {"a USD scene", kOtherMesh}},
    {"off", "", ".off", {"an OFF mesh", kOtherMesh}},
    {"", "off", ".off", {"an OFF mesh", kOtherMesh}},
    {"", "", ".igs", {"an IGES model", kSolid}},
    {"", "", ".iges", {"an IGES model", kSolid}},
    {"", "", ".3ds", {"a 3DS scene", kOtherMesh}},
    {"", "", ".splat", {"Gaussian splats", "they have no surface; make a mesh of the pictures"}},
    {"", "", ".ksplat", {"Gaussian splats", "they have no surface; make a mesh of the pictures"}},
    {"", "", ".spz", {"Gaussian splats", "they have no surface; make a mesh of the pictures"}},
    {"{", "\"sfm_data_version\"", "", {"a file of cameras of OpenMVG", kRig}},
    {"{", "\"featuresfolders\"", "", {"a file of cameras of Meshroom", kRig}},
    {"[", "\"shots\"", "", {"a file of cameras of OpenSfM", kRig}},
    {"[", "\"img_name\"", "", {"a file of cameras of Gaussian splats", kRig}},
    {"{", "\"poseid\"", "", {"a file of cameras of Meshroom", kRig}},
    {"{", "", ".sfm", {"a file of cameras of Meshroom", kRig}},
    {"{", "", ".mg", {"a project of Meshroom", kRig}},
    {"[", "\"reference_lla\"", "", {"a file of cameras of OpenSfM", kRig}},
    {"", "", "sfm_data.bin", {"a file of cameras of OpenMVG", kRig}},
    {"", "", ".mvs", {"a project of OpenMVS", kRig}},
    {"", "", "poses_bounds.npy", {"a file of cameras of LLFF", kRig}},
    {"", "", ".rcproj", {"a project of RealityCapture", kRig}},
    {"<", "<blocksexchange", "", {"a file of cameras of ContextCapture", kRig}},
    {"#cameras ", "", ".csv", {"a file of cameras of RealityCapture", kRig}},
    {"<", "<document", "", {"a file of cameras of Metashape", kRig}},
    {"<", "xcr:", "", {"a camera of RealityCapture", kRig}},
    {"#name,x,y,", "", "", {"a file of cameras of RealityCapture", kRig}},
    {"<", "<mrml", "", {"a scene of 3D Slicer", "save the volume in it, as NRRD"}},
    {"{", "\"asset\"", ".gltf", {"a glTF scene", kMesh}},
    {"{", "\"frames\"", "", {"a file of cameras", kCameras}},
    // SOP classes of DICOM, whose files have no pictures.
    {"",
     "1.2.840.10008.5.1.4.1.1.481.3\0"sv,
     "",
     {"a DICOM RT structure set",
      "make a volume of labels of it, e.g. with plastimatch or 3D Slicer"}},
    {"",
     "1.2.840.10008.5.1.4.1.1.481.5\0"sv,
     "",
     {"a DICOM RT plan", "give the folder of the images or of the dose that it is for"}},
    {"",
     "1.2.840.10008.5.1.4.1.1.481.8\0"sv,
     "",
     {"a DICOM RT plan", "give the folder of the images or of the dose that it is for"}},
    {"",
     "1.2.840.10008.5.1.4.1.1.104.3\0"sv,
     "",
     {"an STL mesh within DICOM", "take it out, `dcmdecap IN OUT.stl` of DCMTK"}},
    {"",
     "1.2.840.10008.5.1.4.1.1.66.5"sv,
     "",
     {"a DICOM surface segmentation", "convert its surfaces to STL, e.g. with 3D Slicer"}},
    {"<?xml", "", "", {"an XML document of an unknown kind", "give the volume itself"}}};

bool has_ending(const std::string& file, std::initializer_list<std::string_view> endings) {
  return std::ranges::any_of(endings, [&](auto ending) { return file.ends_with(ending); });
}

/// Formats within HDF5. `file`: the name in small letters.
Known known_hdf5(const std::string& file, std::string_view head) {
  if (file.ends_with(".mnc") || head.find("minc-2.0") != std::string_view::npos)
    return {"a MINC 2 volume", "convert it to NIfTI, `mnc2nii IN OUT.nii`, or with nibabel"};
  if (file.ends_with(".ims")) return {"an Imaris file", kAsOmeTiff};
  if (head.starts_with("MATLAB 7.3"))
    return {"a MATLAB 7.3 file", "save its array as NIfTI (niftiwrite) or .npy (h5py, numpy)"};
  if (has_ending(file, {".nc", ".nc4", ".cdf"}))
    return {"a NetCDF 4 file", "save one of its variables as .npy, with netCDF4 or xarray"};
  return {"an HDF5 file", "save one of its data sets as .npy, with h5py"};
}

/// Formats that a fixed magic does not tell.
std::optional<Known> known_by_structure(const std::string& file, std::string_view head) {
  constexpr auto kHdf5 = "\x89HDF\r\n\x1a\n"sv;
  for (std::size_t at = 0; at + kHdf5.size() <= head.size(); at = at ? 2 * at : 512)
    if (head.substr(at, kHdf5.size()) == kHdf5) return known_hdf5(file, head);
  if (head.starts_with("CDF") && head.size() > 3 &&
      (head[3] == 1 || head[3] == 2 || head[3] == 5)) {
    if (file.ends_with(".mnc") || head.find("MINC standard variable") != std::string_view::npos)
      return Known{"a MINC 1 volume", "convert it to NIfTI, `mnc2nii IN OUT.nii`, or with nibabel"};
    return Known{"a NetCDF file", "save one of its variables as .npy, with netCDF4 or xarray"};
  }
  if (head.starts_with("\x70\0\0\0"sv) && head.size() > 9 && head[8] == '*')
    return Known{"a Leica LIF file", kAsOmeTiff};
  if (head.starts_with("BM") && has_ending(file, {".bmp"}))
    return Known{"a BMP picture", kOnePicture};
  const std::string start = lower_case(head.substr(0, 4096));
  const std::string_view text = trim(without_byte_order_mark(start));
  for (const auto& [begins, holds, ending, known] : kTexts)
    if (text.starts_with(begins) && text.find(holds) != std::string_view::npos &&
        file.ends_with(ending))
      return known;
  return std::nullopt;
}

/// Formats without a magic. Their names are all there is, so they come last.
std::optional<Known> known_by_name(const std::string& file, const std::string& path) {
  const auto has_partner = [&](std::initializer_list<const char*> endings) {
    std::error_code code;
    return std::ranges::any_of(endings, [&](const char* ending) {
      return fs::exists(fs::path(path).replace_extension(ending), code);
    });
  };
  if (file.ends_with(".stl")) return Known{"an STL mesh", kMesh};
  if (file.ends_with(".obj")) return Known{"an OBJ mesh", kMesh};
  if (has_ending(file, {".xyz", ".pts"})) return Known{"a point cloud", kPoints};
  if (has_ending(file, {".brik"}) && has_partner({".HEAD", ".head"}))
    return Known{"a file of AFNI voxels", "convert it to NIfTI, `3dAFNItoNIFTI IN`"};
  if (file.ends_with(".rec") && has_partner({".par", ".PAR"}))
    return Known{"a file of Philips PAR/REC voxels",
                 "convert it to NIfTI, by its header: `parrec2nii HEADER.PAR`"};
  return std::nullopt;
}

std::optional<Known> known_format(const std::string& path, std::string_view head) {
  const std::string file = lower_case(without_packing(path));
  if (const auto known = known_by_structure(file, head)) return known;
  const std::string_view text = trim(without_byte_order_mark(head));
  for (const Magic& magic : kMagics)
    if ((head.size() > magic.at && head.substr(magic.at).starts_with(magic.bytes)) ||
        (magic.at == 0 && text.starts_with(magic.bytes)))
      return Known{magic.name, magic.way};
  return known_by_name(file, path);
}

tl::unexpected<Error> refusal(const std::string& path, const Known& known) {
  return unsupported(path, known.name, ", which is not read: ", known.way);
}

/// Names the folder within this one that has the most files, for the end of a message.
std::string fullest_within(const std::string& path) {
  std::map<std::string, std::size_t> files;
  std::error_code code, ignored;
  std::size_t left = 100'000;  // entries to look at
  for (fs::recursive_directory_iterator it(path, code), end; !code && it != end && left-- > 0;
       it.increment(code))
    if (const fs::path folder = it->path().parent_path();
        folder != fs::path(path) && it->is_regular_file(ignored))
      ++files[folder.string()];
  const auto most = std::ranges::max_element(files, {}, [](const auto& one) { return one.second; });
  if (most == files.end()) return {};
  return concat("; ", most->first, " has ", most->second, most->second == 1 ? " file" : " files");
}

}  // namespace

Result<void> refuse_known(const std::string& path, std::string_view head) {
  const auto known = known_format(path, head);
  if (known && known->way != kCameras && known->way != kMesh) return refusal(path, *known);
  return {};
}

tl::unexpected<Error> refuse_file(const std::string& path, std::string_view head) {
  if (looks_like_png(head) || looks_like_jpeg(head))
    return unsupported(
        path, "one picture, expected a volume: give the folder that holds the whole stack");
  if (const auto known = known_format(path, head)) return refusal(path, *known);
  const auto packing = packing_of_file(path);
  const std::string where = packing == Packing::none
                                ? " at its start"
                                : std::string(" at its start, unpacked from ") + name(packing);
  const std::string file = lower_case(without_packing(path));
  for (const VolumeFormat& format : volume_formats())
    for (const auto& [ending, start] : format.starts)
      if (file.ends_with(ending))
        return bad_file(path, "expected ", start, ", found ", in_quotes(head.substr(0, 16)), where,
                        ": it is damaged, or misnamed");
  if (file.ends_with(".img"))
    return fail_without(
        "raw", ErrorCode::usage, path, ": voxels of Analyze or NIfTI, whose header is missing (",
        partner_of(path, ".hdr"),
        "); without one they need their layout: dimensions, type, spacing and offset");
  return fail_without(
      "raw", ErrorCode::usage, path, ": of no known format (found ", in_quotes(head.substr(0, 16)),
      where, "); headerless voxels need their layout: dimensions, type, spacing and offset");
}

tl::unexpected<Error> refuse_folder(const std::string& path) {
  std::error_code code;
  for (const auto* file : {".zarray", ".zgroup", ".zattrs", "zarr.json"})
    if (fs::exists(fs::path(path) / file, code))
      return refusal(path, {"a Zarr folder", "save one of its arrays as .npy, with zarr-python"});
  if (fs::exists(fs::path(path) / "attributes.json", code))
    return refusal(path, {"an N5 folder", "save one of its arrays as .npy, with zarr-python"});
  if (fs::exists(fs::path(path) / "method", code) && fs::exists(fs::path(path) / "acqp", code))
    return refusal(path, {"a Bruker ParaVision scan", "convert it, with dcm2niix or brkraw"});

  std::map<std::string_view, std::size_t> kinds;
  std::size_t files = 0, folders = 0;
  std::string first_volume;
  for (auto it = fs::directory_iterator(path, code); !code && it != fs::directory_iterator();
       it.increment(code)) {
    std::error_code ignored;
    folders += it->is_directory(ignored);
    if (!it->is_regular_file(ignored)) continue;
    ++files;
    const std::string file = it->path().string();
    const auto head = read_head(file, 4096);
    if (!head) continue;
    if (const auto known = known_format(file, *head)) ++kinds[known->name];
    if (first_volume.empty() || file < first_volume)
      if (format_of(*head)) first_volume = file;
  }
  if (!first_volume.empty())
    return unsupported(path, "a folder of ", files,
                       " files; give the one that is the volume, such as ", first_volume);
  if (files == 0)
    return bad_file(path, "the folder holds no files", folders ? ", only folders" : "",
                    ": give the folder that holds the slices themselves", fullest_within(path));
  const std::string found = joined(kinds, ", ", [](const auto& kind) {
    return (kind.second == 1 ? "once " : concat(kind.second, " times ")).append(kind.first);
  });
  return bad_file(path, "among its ", files, " files is no DICOM picture, PNG, JPEG or TIFF",
                  found.empty() ? "" : " (" + found + ")",
                  ": give the folder that holds the slices themselves", fullest_within(path));
}

Result<void> refuse_series(const std::string& path, const VolumeOptions& options) {
  if (!options.series) return {};
  return misuse(path, "series ", in_quotes(*options.series),
                " was chosen, but this is not DICOM, which alone has series");
}

}  // namespace slf::volume_io

namespace slf {

std::string volume_format_names() {
  std::string names;
  for (const auto& format : volume_io::volume_formats())
    if (!format.names.empty()) names.append(names.empty() ? "" : ", ").append(format.names);
  return names;
}

}  // namespace slf
