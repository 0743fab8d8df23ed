// JPEG through libjpeg-turbo.

#include <cstdio>  // before jpeglib.h, which uses FILE
// A separate block of includes, because jpeglib.h needs the above.
#include <jerror.h>
#include <jpeglib.h>

#include <algorithm>
#include <csetjmp>
#include <cstdlib>

#include "base/try.h"
#include "image/formats.h"

namespace slf::image_formats {
namespace {

/// A hostile progressive file may have many empty scans that cost time. Real ones have about ten.
constexpr int kMaxScans = 500;

/// Turns libjpeg's fatal errors into a message. Must live as long as the jpeg struct that uses it.
class JpegErrors {
 public:
  jpeg_error_mgr* install() {
    jpeg_std_error(&manager_);
    manager_.error_exit = [](j_common_ptr jpeg) { self(jpeg).stop(jpeg); };
    manager_.emit_message = [](j_common_ptr jpeg, int level) {
      if (level < 0 && !harmless(jpeg->err->msg_code)) self(jpeg).stop(jpeg);
    };
    return &manager_;
  }

  /// Runs calls into libjpeg. False: one of them failed.
  /// REQUIRES: `calls` has no objects with destructors, because a longjmp may leave it.
  template <class Calls>
  [[nodiscard]] bool run(const Calls& calls) {
    if (setjmp(back_) != 0) return false;
    calls();
    return true;
  }

  [[nodiscard]] const char* message() const { return message_; }

 private:
  static JpegErrors& self(j_common_ptr jpeg) {
    return *static_cast<JpegErrors*>(jpeg->client_data);
  }

  /// All other warnings mean that pixels are missing or invented.
  static bool harmless(int code) {
    return code == JWRN_JFIF_MAJOR || code == JWRN_ADOBE_XFORM || code == JWRN_BOGUS_ICC;
  }

  [[noreturn]] void stop(j_common_ptr jpeg) {
    manager_.format_message(jpeg, message_);
    std::longjmp(back_, 1);
  }

  jpeg_error_mgr manager_{};
  std::jmp_buf back_{};
  char message_[JMSG_LENGTH_MAX] = "";
};

struct Compressor {
  JpegErrors errors;
  jpeg_compress_struct jpeg{};
  unsigned char* bytes = nullptr;  ///< malloc'ed by libjpeg
  unsigned long size = 0;

  Compressor() = default;
  Compressor(const Compressor&) = delete;
  Compressor& operator=(const Compressor&) = delete;
  ~Compressor() {
    jpeg_destroy_compress(&jpeg);
    std::free(bytes);
  }

  void compress(const std::uint8_t* rgb, std::uint32_t width, std::uint32_t height, int quality) {
    jpeg_create_compress(&jpeg);
    jpeg.image_width = width;
    jpeg.image_height = height;
    jpeg.input_components = 3;
    jpeg.in_color_space = JCS_RGB;
    jpeg_mem_dest(&jpeg, &bytes, &size);
    jpeg_set_defaults(&jpeg);
    jpeg_set_quality(&jpeg, quality, TRUE);
    // Full-resolution chroma, because rendered surfaces have sharp coloured edges.
    for (int c = 0; c < 3; ++c)
      jpeg.comp_info[c].h_samp_factor = jpeg.comp_info[c].v_samp_factor = 1;
    jpeg_start_compress(&jpeg, TRUE);
    while (jpeg.next_scanline < height) {
      // The library's row pointer is non-const, but it does not write to the row.
      auto* row = const_cast<std::uint8_t*>(rgb + std::size_t{jpeg.next_scanline} * width * 3);
      jpeg_write_scanlines(&jpeg, &row, 1);
    }
    jpeg_finish_compress(&jpeg);
  }
};

struct Decompressor {
  JpegErrors errors;
  jpeg_decompress_struct jpeg{};
  jpeg_progress_mgr progress{};

  Decompressor() = default;
  Decompressor(const Decompressor&) = delete;
  Decompressor& operator=(const Decompressor&) = delete;
  ~Decompressor() { jpeg_destroy_decompress(&jpeg); }

  void read_header(ByteSpan bytes) {
    jpeg_create_decompress(&jpeg);
    progress.progress_monitor = [](j_common_ptr common) {
      if (reinterpret_cast<j_decompress_ptr>(common)->input_scan_number > kMaxScans)
        ERREXIT(common, JERR_BAD_PROGRESSION);
    };
    jpeg.progress = &progress;
    jpeg_mem_src(&jpeg, reinterpret_cast<const unsigned char*>(bytes.data()), bytes.size());
    jpeg_read_header(&jpeg, TRUE);
  }

  /// REQUIRES: width × height × channels bytes at `samples`; 1 channel of grey or 3 of colour.
  void read_pixels(std::uint8_t* samples, std::size_t channels) {
    jpeg.out_color_space = channels == 1 ? JCS_GRAYSCALE : JCS_RGB;
    jpeg_start_decompress(&jpeg);
    while (jpeg.output_scanline < jpeg.output_height) {
      std::uint8_t* row =
          samples + std::size_t{jpeg.output_scanline} * jpeg.output_width * channels;
      jpeg_read_scanlines(&jpeg, &row, 1);
    }
    jpeg_finish_decompress(&jpeg);
  }
};

}  // namespace

Result<Bytes> encode_jpeg(const std::string& name, const Image& image,
                          const ImageFileOptions& options) {
  const std::vector<std::uint8_t> rgb = to_rgb8(image, options.background);
  Compressor compressor;
  compressor.jpeg.err = compressor.errors.install();
  compressor.jpeg.client_data = &compressor.errors;
  const int quality = std::clamp(options.jpeg_quality, 1, 100);
  if (!compressor.errors.run(
          [&] { compressor.compress(rgb.data(), image.width, image.height, quality); }))
    return fail(ErrorCode::failed, name, ": cannot encode as JPEG: ", compressor.errors.message());
  const auto* begin = reinterpret_cast<const std::byte*>(compressor.bytes);
  return Bytes(begin, begin + compressor.size);
}

Result<JpegSamples> decode_jpeg_samples(const std::string& name, ByteSpan bytes) {
  Decompressor decompressor;
  decompressor.jpeg.err = decompressor.errors.install();
  decompressor.jpeg.client_data = &decompressor.errors;
  const auto damaged = [&] {
    return bad_file(name, "damaged JPEG: ", decompressor.errors.message());
  };
  if (!decompressor.errors.run([&] { decompressor.read_header(bytes); })) return damaged();

  const auto& jpeg = decompressor.jpeg;
  SLF_TRY(check_size(name, jpeg.image_width, jpeg.image_height));
  // A block of 8x8 pixels takes a bit or more, unless it is coded arithmetically.
  constexpr std::uint64_t kMaxPixelsPerByte = 8192;
  if (std::uint64_t{jpeg.image_width} * jpeg.image_height > bytes.size() * kMaxPixelsPerByte)
    return bad_file(name, "damaged JPEG: ", jpeg.image_width, "x", jpeg.image_height,
                    " pixels cannot be in ", bytes.size(), " bytes");
  if (jpeg.jpeg_color_space == JCS_CMYK || jpeg.jpeg_color_space == JCS_YCCK)
    return unsupported(name, "JPEG in CMYK; only grey and colour are read");

  JpegSamples image{
      jpeg.image_width, jpeg.image_height, jpeg.jpeg_color_space == JCS_GRAYSCALE ? 1u : 3u, {}};
  image.samples.resize(std::size_t{image.width} * image.height * image.channels);
  if (!decompressor.errors.run(
          [&] { decompressor.read_pixels(image.samples.data(), image.channels); }))
    return damaged();
  return image;
}

Result<Image> decode_jpeg(const std::string& name, ByteSpan bytes) {
  const auto decoded = SLF_TRY(decode_jpeg_samples(name, bytes));
  Image image{decoded.width, decoded.height, {}, {}};
  const auto& samples = decoded.samples;
  image.rgba.reserve(std::size_t{image.width} * image.height);
  for (std::size_t i = 0; i < samples.size(); i += decoded.channels) {
    const std::size_t green = i + (decoded.channels > 1 ? 1 : 0);
    const std::size_t blue = i + (decoded.channels > 1 ? 2 : 0);
    image.rgba.emplace_back(glm::vec3(samples[i], samples[green], samples[blue]) / 255.0F, 1.0F);
  }
  return image;
}

}  // namespace slf::image_formats
