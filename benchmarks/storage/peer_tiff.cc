// BigTIFF: the tiles' mosaics as ordinary JPEG tiles, decoded by libtiff. It holds no alpha, so it
// has less to decode than the others.
#include <tiffio.h>

#include <algorithm>
#include <cstring>

#include "benchmarks/storage/expect.h"
#include "benchmarks/storage/store_peer.h"
#include "codec/jpeg_pictures.h"

namespace slf::bench {
namespace {

struct Close {
  void operator()(TIFF* file) const { TIFFClose(file); }
};
using File = std::unique_ptr<TIFF, Close>;

std::uint32_t round_up(std::size_t n) { return static_cast<std::uint32_t>((n + 15) / 16 * 16); }

codec::Mosaic mosaic_of(const TileShape& tile) { return {tile.rows(), tile.side, 1}; }

struct Size {
  std::uint32_t width = 0, height = 0;
};

// All tiles of a TIFF have one size: that of the largest mosaic.
Size tile_size(const TileSet& set) {
  Size size;
  for (const TileShape& tile : set.shapes) {
    const codec::Mosaic mosaic = mosaic_of(tile);
    size.width = std::max(size.width, round_up(mosaic.width()));
    size.height = std::max(size.height, round_up(mosaic.height()));
  }
  return size;
}

// Calls use(sample, pixel of the TIFF's tile).
template <class Use>
void walk(const TileShape& tile, std::uint32_t tile_width, Use use) {
  const codec::Mosaic mosaic = mosaic_of(tile);
  const std::size_t gap = tile_width - mosaic.width();
  for (std::size_t row = 0, sample = 0; row < tile.rows(); ++row)
    for (std::uint32_t q = 0; q <= tile.side; ++q) {
      const codec::MosaicLine line = mosaic.line(row, q);
      auto pixel = static_cast<std::ptrdiff_t>(line.start + line.start / mosaic.width() * gap);
      for (std::uint32_t p = 0; p <= tile.side - q; ++p, pixel += line.step)
        use(sample++, static_cast<std::size_t>(pixel));
    }
}

class TiffReader final : public StoreReader {
 public:
  TiffReader(const TileSet& set, const std::string& path)
      : StoreReader(set), file_(TIFFOpen(path.c_str(), "r")) {
    require(file_ != nullptr, path + ": libtiff cannot open");
    TIFFSetField(file_.get(), TIFFTAG_JPEGCOLORMODE, JPEGCOLORMODE_RGB);
    TIFFGetField(file_.get(), TIFFTAG_TILEWIDTH, &width_);
    pixels_.resize(static_cast<std::size_t>(TIFFTileSize(file_.get())));
  }

  ByteSpan get(std::size_t) override { return {}; }

  void read(std::size_t tile, Bytes& samples) override {
    require(TIFFReadEncodedTile(file_.get(), static_cast<std::uint32_t>(tile), pixels_.data(),
                                static_cast<tmsize_t>(pixels_.size())) >= 0,
            "libtiff cannot read a tile");
    samples.resize(set().shapes[tile].bytes());
    walk(set().shapes[tile], width_, [&](std::size_t sample, std::size_t pixel) {
      std::memcpy(&samples[sample * 4], &pixels_[pixel * 3], 3);
      samples[sample * 4 + 3] = std::byte{255};
    });
  }

 private:
  File file_;
  std::uint32_t width_ = 0;
  Bytes pixels_;
};

class TiffStore final : public OpenStore {
 public:
  TiffStore(const TileSet& set, std::string path) : set_(set), path_(std::move(path)) {
    (void)reader();  // pays the cost of opening in advance
  }
  std::unique_ptr<StoreReader> reader() const override {
    return std::make_unique<TiffReader>(set_, path_);
  }

 private:
  const TileSet& set_;
  std::string path_;
};

class Tiff final : public StorePeer {
 public:
  std::string name() const override { return "BigTIFF JPEG"; }
  bool can_store(const TileSet& set) const override { return set.jpeg_color(); }
  bool returns_payloads() const override { return false; }

  void write(const TileSet& set, const std::string& path) const override {
    const Size size = tile_size(set);
    const File file(TIFFOpen(path.c_str(), "w8"));
    require(file != nullptr, path + ": libtiff cannot create");
    TIFF* tiff = file.get();
    TIFFSetField(tiff, TIFFTAG_IMAGEWIDTH, size.width);
    TIFFSetField(tiff, TIFFTAG_IMAGELENGTH, size.height * static_cast<std::uint32_t>(set.size()));
    TIFFSetField(tiff, TIFFTAG_TILEWIDTH, size.width);
    TIFFSetField(tiff, TIFFTAG_TILELENGTH, size.height);
    TIFFSetField(tiff, TIFFTAG_SAMPLESPERPIXEL, 3);
    TIFFSetField(tiff, TIFFTAG_BITSPERSAMPLE, 8);
    TIFFSetField(tiff, TIFFTAG_PLANARCONFIG, PLANARCONFIG_CONTIG);
    TIFFSetField(tiff, TIFFTAG_COMPRESSION, COMPRESSION_JPEG);
    TIFFSetField(tiff, TIFFTAG_PHOTOMETRIC, PHOTOMETRIC_YCBCR);
    TIFFSetField(tiff, TIFFTAG_YCBCRSUBSAMPLING, 2, 2);
    TIFFSetField(tiff, TIFFTAG_JPEGQUALITY, 75);
    TIFFSetField(tiff, TIFFTAG_JPEGCOLORMODE, JPEGCOLORMODE_RGB);
    Bytes samples;
    for (std::size_t i = 0; i < set.size(); ++i) {
      set.decode(i, set.payloads[i], samples);
      Bytes pixels(std::size_t{size.width} * size.height * 3);
      walk(set.shapes[i], size.width, [&](std::size_t sample, std::size_t pixel) {
        std::memcpy(&pixels[pixel * 3], &samples[sample * 4], 3);
      });
      require(TIFFWriteEncodedTile(tiff, static_cast<std::uint32_t>(i), pixels.data(),
                                   static_cast<tmsize_t>(pixels.size())) >= 0,
              "libtiff cannot write a tile");
    }
  }

  std::unique_ptr<OpenStore> open(const TileSet& set, const std::string& path) const override {
    return std::make_unique<TiffStore>(set, path);
  }
};

}  // namespace

std::unique_ptr<StorePeer> make_tiff() { return std::make_unique<Tiff>(); }

}  // namespace slf::bench
