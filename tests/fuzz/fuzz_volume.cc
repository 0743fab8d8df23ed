// The volume readers on any bytes: an error that names the file, or a volume that keeps its
// promises. The first byte chooses how the rest is read; see Way.
#include <zlib.h>

#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <string>
#include <string_view>

#include "slf/transfer.h"
#include "slf/volume.h"
#include "source/volume/dicom/dicom.h"
#include "tests/temporary_folder.h"

namespace {

enum Way : int {
  as_is,   // a file with these bytes, of whatever format they are
  packed,  // the same, gzipped first, so that mutations reach what is inside
  labels,  // a file read as labels
  raw_8,   // a raw file with a layout
  dicom,   // one DICOM file: header, then pixels
  folder,  // a folder that holds the bytes twice, as slices
  chosen,  // as is, with a component, a time and a crop chosen
  series,  // a folder of two files: two bytes state the length of the first
  named,   // as is, with an array and a spacing chosen
  ways
};

void require(bool condition) {
  if (!condition) std::abort();
}

// A folder of this process, with data files that headers may name, and the voxels of `input` if
// that is the header of a pair.
struct Scratch : slf::testing::TemporaryFolder {
  Scratch() {
    require(!path().empty());
    for (const auto* name : {"/d.raw", "/input.img"})
      std::ofstream(path() + name, std::ios::binary) << std::string(4096, 'x');
    std::ofstream(path() + "/p.vti")
        << R"(<VTKFile type="ImageData"><ImageData WholeExtent="0 1 0 1 0 1">)"
        << R"(<Piece Extent="0 1 0 1 0 1"><PointData>)"
        << R"(<DataArray type="UInt8" Name="b" format="ascii">1 2 3 4 5 6 7 8</DataArray>)"
        << "</PointData></Piece></ImageData></VTKFile>";
  }
};

const std::string& scratch() {
  static const Scratch kScratch;
  return kScratch.path();
}

std::string write(std::string_view bytes) {
  const std::string path = scratch() + "/input";
  std::ofstream(path, std::ios::binary) << bytes;
  return path;
}

std::string gzipped(std::string_view bytes) {
  const std::string path = scratch() + "/packed";
  const gzFile file = gzopen(path.c_str(), "wb1");
  require(file != nullptr);
  if (!bytes.empty()) gzwrite(file, bytes.data(), static_cast<unsigned>(bytes.size()));
  gzclose(file);
  return path;
}

void check(const std::string& path, const slf::VolumeOptions& options) {
  const auto volume = slf::read_volume(path, options);
  if (!volume) {
    require(volume.error().message.find(path.substr(0, path.rfind('/'))) == 0);
    return;
  }
  require(volume->voxels.size() == volume->voxel_count() * slf::bytes_per_voxel(volume->type));
  for (int i = 0; i < 3; ++i) {
    require(volume->dims[static_cast<std::size_t>(i)] >= 2);
    require(volume->spacing()[i] > 0 && std::isfinite(volume->origin[i]));
  }
  require(std::isfinite(volume->slope) && volume->slope != 0 && std::isfinite(volume->intercept));
  require(std::abs(glm::determinant(volume->axes)) > 0);
  const auto [min, max] = volume->value_range();
  require(min <= max);
  const auto transfer = slf::default_transfer(*volume);
  require(slf::parse_transfer(slf::to_json(transfer), "default").has_value());
}

/// Two slices with these bytes: PNGs or TIFFs, say.
std::string folder_of(std::string_view bytes) {
  const std::string path = scratch() + "/stack";
  std::filesystem::create_directory(path);
  for (const auto* name : {"/1", "/2"}) std::ofstream(path + name, std::ios::binary) << bytes;
  return path;
}

void check_series(std::string_view bytes, bool spaced) {
  if (bytes.size() < 2) return;
  const auto length = static_cast<std::size_t>(static_cast<unsigned char>(bytes[0]) |
                                               static_cast<unsigned char>(bytes[1]) << 8);
  bytes.remove_prefix(2);
  const std::string path = scratch() + "/series";
  std::filesystem::create_directory(path);
  const auto first = bytes.substr(0, length);
  std::ofstream(path + "/1.dcm", std::ios::binary) << first;
  std::ofstream(path + "/2.dcm", std::ios::binary) << bytes.substr(first.size());
  slf::VolumeOptions options{.resample = true};
  if (spaced) options.spacing = glm::dvec3(1, 2, 3);
  check(path, options);
  const auto list = slf::list_series(path);
  require(!list || !list->series.empty());
}

void check_dicom(const std::string& path) {
  const auto slices = slf::volume_io::read_dicom_slices(path);
  if (!slices || slices->empty()) return;
  const auto& slice = slices->back();
  if (slice.problem) return;
  const auto check_size = [&](std::size_t, const std::vector<std::byte>& pixels) {
    require(pixels.size() == std::size_t{slice.width} * slice.height * slice.components() *
                                 slf::bytes_per_voxel(slice.component_type()));
    return slf::Result<void>();
  };
  (void)slf::volume_io::for_each_frame({slice}, check_size);
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size == 0) return 0;
  const std::string_view bytes(reinterpret_cast<const char*>(data) + 1, size - 1);
  switch (data[0] % ways) {
    case as_is:
      check(write(bytes), {});
      break;
    case packed:
      check(gzipped(bytes), {});
      break;
    case labels:
      check(write(bytes), {.raw = {}, .labels = true});
      break;
    case raw_8: {
      slf::RawLayout layout;
      layout.dims = {2, 3, 4};
      layout.type = static_cast<slf::ScalarType>(size % 10);
      layout.big_endian = size % 2 == 1;
      check(write(bytes), {.raw = layout});
      break;
    }
    case folder:
      check(folder_of(bytes), {});
      break;
    case chosen:
      check(write(bytes), {.component = static_cast<std::uint32_t>(size % 2),
                           .time = 1,
                           .crop = slf::VoxelBox{{0, 0, 1}, {}}});
      break;
    case series:
      check_series(bytes, size % 2 == 1);
      break;
    case named:
      check(write(bytes), {.array = "b", .spacing = glm::dvec3(1, 2, 3)});
      break;
    default:
      check_dicom(write(bytes));
  }
  return 0;
}
