#include "codec/alpha_coder.h"

#include <algorithm>
#include <array>
#include <cstring>
#include <vector>

#include "base/varint.h"
#include "codec/scratch.h"
#include "codec/zstd_frame.h"

namespace slf::codec {
namespace {

// gaps: for each sample that differs from its flat neighbourhood, the number of samples before it
// that do not. breaks: the residuals of those that differ. edges: residuals along edges, in four
// streams, by whether N and W are neither transparent nor opaque.
enum Stream : std::size_t { gaps, breaks, edges, stream_count = edges + 4 };

// A gap of 255 or more takes several bytes; all but the last are 255.
constexpr std::size_t kLongGap = 255;

struct Neighbours {
  std::uint8_t w, n, nw, ne;
  bool flat() const { return w == n && n == nw && nw == ne; }
  std::uint8_t median_edge() const {
    const int low = std::min(w, n), high = std::max(w, n);
    return static_cast<std::uint8_t>(std::clamp(w + n - nw, low, high));
  }
  Stream stream(std::uint8_t top) const {
    const auto soft = [&](std::uint8_t value) { return value != 0 && value != top ? 1u : 0u; };
    return static_cast<Stream>(edges + soft(n) + 2 * soft(w));
  }
};

// The neighbours of sample p of a line. `above` is the line above, which is one sample longer; null
// for the first line of a picture.
Neighbours neighbours_of(const std::uint8_t* line, const std::uint8_t* above, std::size_t p,
                         std::uint8_t before_picture) {
  if (!above) {
    const std::uint8_t w = p > 0 ? line[p - 1] : before_picture;
    return {w, w, w, w};
  }
  if (p == 0) return {above[0], above[0], above[0], above[1]};
  return {line[p - 1], above[p], above[p - 1], above[p + 1]};
}

class Encoder {
 public:
  explicit Encoder(std::uint8_t top) : top_(top) {}

  void add(std::uint8_t value, const Neighbours& near) {
    if (!near.flat()) {
      put(near.stream(top_), static_cast<std::uint8_t>(value - near.median_edge()));
    } else if (value == near.w) {
      ++gap_;
    } else {
      for (; gap_ >= kLongGap; gap_ -= kLongGap) put(gaps, kLongGap);
      put(gaps, static_cast<std::uint8_t>(gap_));
      put(breaks, static_cast<std::uint8_t>(value - near.w));
      gap_ = 0;
    }
  }

  const std::array<Bytes, stream_count>& streams() const { return streams_; }

 private:
  void put(Stream stream, std::size_t value) {
    streams_[stream].push_back(static_cast<std::byte>(value));
  }
  std::uint8_t top_;
  std::size_t gap_ = 0;
  std::array<Bytes, stream_count> streams_;
};

class Decoder {
 public:
  Decoder(std::span<const std::uint8_t> bytes, const std::array<std::size_t, stream_count>& sizes,
          std::uint8_t top)
      : top_(top) {
    const std::uint8_t* at = bytes.data();
    for (std::size_t i = 0; i < stream_count; ++i) {
      next_[i] = at;
      end_[i] = at += sizes[i];
    }
    read_gap();
  }

  void decode_line(std::uint8_t* line, const std::uint8_t* above, std::size_t length,
                   std::uint8_t before_picture) {
    for (std::size_t p = 0; p < length;) {
      const Neighbours near = neighbours_of(line, above, p, before_picture);
      if (!near.flat()) {
        line[p++] = static_cast<std::uint8_t>(near.median_edge() + take(near.stream(top_)));
      } else if (gap_ == 0) {
        line[p++] = static_cast<std::uint8_t>(near.w + take(breaks));
        read_gap();
      } else {
        // The following samples have the same flat neighbourhood while the line above is constant.
        std::size_t end = p + 1;
        const std::size_t limit = std::min(length, p + gap_);
        if (above)
          while (end < limit && above[end + 1] == near.w) ++end;
        else
          end = limit;
        std::memset(line + p, near.w, end - p);
        gap_ -= end - p;
        p = end;
      }
    }
  }

  // Whether every byte was read and none was missing.
  bool complete() const { return !overrun_ && next_ == end_; }

 private:
  std::uint8_t take(Stream stream) {
    if (next_[stream] != end_[stream]) return *next_[stream]++;
    overrun_ = true;
    return 0;
  }
  // After the last gap there are no more breaks.
  void read_gap() {
    gap_ = 0;
    while (true) {
      if (next_[gaps] == end_[gaps]) {
        gap_ = ~std::size_t{0} / 2;
        return;
      }
      const std::uint8_t byte = *next_[gaps]++;
      gap_ += byte;
      if (byte != kLongGap) return;
    }
  }

  std::uint8_t top_;
  std::size_t gap_ = 0;
  bool overrun_ = false;
  std::array<const std::uint8_t*, stream_count> next_;
  std::array<const std::uint8_t*, stream_count> end_;
};

// Calls use(line, above or null, length, first sample of the previous picture) for every line.
template <class Byte, class Use>
void for_each_line(std::span<Byte> alpha, std::uint32_t side, Use use) {
  Byte* line = alpha.data();
  std::uint8_t before_picture = 0;
  while (line != alpha.data() + alpha.size()) {
    Byte* const picture = line;
    Byte* above = nullptr;
    for (std::size_t length = side + 1; length > 0; --length) {
      use(line, above, length, before_picture);
      above = line;
      line += length;
    }
    before_picture = *picture;
  }
}

}  // namespace

Result<void> append_alpha(std::span<const std::uint8_t> alpha, std::uint32_t side, std::uint8_t top,
                          Bytes& payload) {
  Encoder encoder(top);
  for_each_line(alpha, side, [&](auto* line, auto* above, std::size_t length, auto before) {
    for (std::size_t p = 0; p < length; ++p)
      encoder.add(line[p], neighbours_of(line, above, p, before));
  });
  for (const Bytes& stream : encoder.streams()) append_varint(payload, stream.size());
  std::array<ByteSpan, stream_count> parts;
  std::copy(encoder.streams().begin(), encoder.streams().end(), parts.begin());
  return append_parts(parts, payload);
}

Result<void> read_alpha(ByteSpan& payload, std::uint32_t side, std::uint8_t top,
                        std::span<std::uint8_t> alpha) {
  std::array<std::size_t, stream_count> sizes;
  std::size_t total = 0;
  for (std::size_t& size : sizes) {
    const auto read = take_varint(payload);
    // No stream has more than two bytes per sample. This bounds the allocation.
    if (!read || *read > 2 * alpha.size())
      return fail(ErrorCode::bad_file, "alpha: the sizes are damaged");
    total += size = *read;
  }
  thread_local Scratch<std::uint8_t> scratch;
  const std::span<std::uint8_t> bytes = scratch.take(total);
  if (auto done = read_stream(payload, std::as_writable_bytes(bytes)); !done) return done;
  Decoder decoder(bytes, sizes, top);
  for_each_line(alpha, side, [&](auto* line, auto* above, std::size_t length, auto before) {
    decoder.decode_line(line, above, length, before);
  });
  if (!decoder.complete()) return fail(ErrorCode::bad_file, "alpha: bytes missing or too many");
  return {};
}

}  // namespace slf::codec
