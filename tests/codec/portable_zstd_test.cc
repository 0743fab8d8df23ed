// The decoder of zstd frames that WebAssembly uses, beside libzstd.
#include <zstd.h>

#include <gtest/gtest.h>

#include "codec/zstd_frame.h"
#include "tests/codec/sample_tiles.h"

// The portable definitions, under names of their own.
#define read_stream portable_read_stream
#define append_stream portable_append_stream
#include "codec/portable/zstd_frame.cc"
#undef read_stream
#undef append_stream

namespace slf::codec {
namespace {

Bytes text_like(std::size_t size, std::uint64_t seed, unsigned symbols, unsigned repeats) {
  Random random(seed);
  Bytes bytes;
  while (bytes.size() < size) {
    if (repeats > 0 && bytes.size() > 16 && random.below(100) < repeats) {
      const std::size_t from = random.below(bytes.size() - 8), length = 3 + random.below(300);
      for (std::size_t i = 0; i < length && bytes.size() < size; ++i)
        bytes.push_back(bytes[from + i]);
    } else {
      // Small values are frequent.
      bytes.push_back(static_cast<std::byte>(random.below(1 + random.below(symbols))));
    }
  }
  return bytes;
}

Bytes compressed(ByteSpan content, int level, bool checksum = false) {
  ZSTD_CCtx* context = ZSTD_createCCtx();
  ZSTD_CCtx_setParameter(context, ZSTD_c_compressionLevel, level);
  ZSTD_CCtx_setParameter(context, ZSTD_c_checksumFlag, checksum ? 1 : 0);
  Bytes frame(ZSTD_compressBound(content.size()));
  frame.resize(ZSTD_compress2(context, frame.data(), frame.size(), content.data(), content.size()));
  ZSTD_freeCCtx(context);
  return frame;
}

TEST(PortableZstd, DecodesWhatLibzstdWrites) {
  std::uint64_t seed = 0;
  for (const std::size_t size :
       {1, 2, 5, 31, 100, 255, 256, 257, 1000, 20000, 70000, 300000, 1000000})
    for (const unsigned symbols : {1u, 2u, 7u, 40u, 255u})
      for (const unsigned repeats : {0u, 2u, 30u})
        for (const int level : {-5, 1, 3, 9, 19}) {
          if (size > 100000 && level > 9) continue;
          const Bytes content = text_like(size, ++seed, symbols, repeats);
          Bytes frame = compressed(content, level, seed % 2 == 0);
          frame.push_back(std::byte{42});  // the next one's
          ByteSpan rest = frame;
          Bytes found(size);
          const auto done = portable_read_stream(rest, found);
          ASSERT_TRUE(done) << done.error().message << " size " << size << " symbols " << symbols
                            << " repeats " << repeats << " level " << level;
          ASSERT_EQ(found, content);
          ASSERT_EQ(rest.size(), 1u);
        }
}

TEST(PortableZstd, RefusesAnotherSizeAndCutFrames) {
  const Bytes content = text_like(5000, 1, 40, 10);
  const Bytes frame = compressed(content, 3, true);
  for (const std::size_t size : {content.size() - 1, content.size() + 1}) {
    Bytes found(size);
    ByteSpan rest = frame;
    EXPECT_FALSE(portable_read_stream(rest, found));
  }
  Bytes found(content.size());
  for (std::size_t size = 0; size < frame.size(); ++size) {
    const Bytes cut(frame.begin(), frame.begin() + static_cast<std::ptrdiff_t>(size));
    ByteSpan rest = cut;
    EXPECT_FALSE(portable_read_stream(rest, found)) << size;
  }
}

TEST(PortableZstd, AgreesWithLibzstdOnDamage) {
  Random random(5);
  int accepted = 0;
  for (int trial = 0; trial < 20000; ++trial) {
    const Bytes content = text_like(200 + random.below(3000), 100 + trial % 7, 60, trial % 3 * 10);
    Bytes frame = compressed(content, 1 + trial % 9);
    for (std::size_t k = 0; k <= random.below(3); ++k)
      frame[4 + random.below(frame.size() - 4)] ^= static_cast<std::byte>(1u << random.below(8));
    Bytes expected(content.size()), found(content.size());
    ByteSpan rest = frame, portable_rest = frame;
    const auto by_library = read_stream(rest, expected);
    const auto by_us = portable_read_stream(portable_rest, found);
    // libzstd does not see all damage; what both accept must be the same.
    if (!by_library || !by_us) continue;
    ++accepted;
    ASSERT_EQ(found, expected) << trial;
  }
  EXPECT_GT(accepted, 0);
}

}  // namespace
}  // namespace slf::codec
