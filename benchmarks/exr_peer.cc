// Encodes pictures with OpenEXR's lossy codec: measures the bytes, and writes the decoded pictures.
//
//   exr_peer FRAMES.rgb OUT.rgb --edge N --level L
//
// FRAMES.rgb is 8-bit RGB, picture after picture, N pixels an edge. Each becomes an EXR file with
// half-float RGB and DWAA compression of that level (45 is OpenEXR's default), is read back, and is
// appended to OUT.rgb. Prints the bytes of all files as JSON.
#include <ImfArray.h>
#include <ImfHeader.h>
#include <ImfRgbaFile.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>

int main(int argc, char** argv) {
  CLI::App app{"OpenEXR's lossy codec on pictures"};
  std::string input, output;
  int edge = 0;
  float level = 45;
  app.add_option("input", input)->required();
  app.add_option("output", output)->required();
  app.add_option("--edge", edge)->required()->check(CLI::Range(1, 1 << 14));
  app.add_option("--level", level)->capture_default_str();
  CLI11_PARSE(app, argc, argv);

  const std::string temporary = output + ".exr";
  std::ifstream from(input, std::ios::binary);
  std::ofstream to(output, std::ios::binary);
  const auto pixels = static_cast<std::size_t>(edge) * static_cast<std::size_t>(edge);
  std::vector<unsigned char> picture(3 * pixels);
  std::uint64_t bytes = 0;
  Imf::Array2D<Imf::Rgba> rgba(edge, edge);
  const auto byte = [](float v) {
    return static_cast<unsigned char>(std::lround(255 * std::clamp(v, 0.f, 1.f)));
  };
  while (from.read(reinterpret_cast<char*>(picture.data()),
                   static_cast<std::streamsize>(picture.size()))) {
    for (std::size_t k = 0; k < pixels; ++k) {
      const unsigned char* p = picture.data() + 3 * k;
      rgba[0][k] = Imf::Rgba(p[0] / 255.f, p[1] / 255.f, p[2] / 255.f);
    }
    {
      Imf::Header header(edge, edge);
      header.compression() = Imf::DWAA_COMPRESSION;
      header.dwaCompressionLevel() = level;
      Imf::RgbaOutputFile file(temporary.c_str(), header, Imf::WRITE_RGB);
      file.setFrameBuffer(&rgba[0][0], 1, static_cast<std::size_t>(edge));
      file.writePixels(edge);
    }
    bytes += std::filesystem::file_size(temporary);
    Imf::RgbaInputFile file(temporary.c_str());
    file.setFrameBuffer(&rgba[0][0], 1, static_cast<std::size_t>(edge));
    file.readPixels(0, edge - 1);
    for (std::size_t k = 0; k < pixels; ++k) {
      const Imf::Rgba& v = rgba[0][k];
      unsigned char* p = picture.data() + 3 * k;
      p[0] = byte(v.r), p[1] = byte(v.g), p[2] = byte(v.b);
    }
    to.write(reinterpret_cast<const char*>(picture.data()),
             static_cast<std::streamsize>(picture.size()));
  }
  std::filesystem::remove(temporary);
  std::printf("%s\n", nlohmann::json{{"bytes", bytes}}.dump().c_str());
  return 0;
}
