#include "codec/zstd_frame.h"

#include <zstd.h>

#include <memory>
#include <utility>

namespace slf::codec {
namespace {

struct FreeContext {
  void operator()(ZSTD_CCtx* context) const { ZSTD_freeCCtx(context); }
  void operator()(ZSTD_DCtx* context) const { ZSTD_freeDCtx(context); }
};

using Parameters = std::initializer_list<std::pair<ZSTD_cParameter, int>>;

// Accidental matches in residuals cost more than they save. With a hash table too small to find
// many, zstd mostly uses its Huffman coder, which is also the fastest.
constexpr Parameters kEntropyOnly = {{ZSTD_c_strategy, ZSTD_fast},
                                     {ZSTD_c_hashLog, 6},
                                     {ZSTD_c_minMatch, 7},
                                     {ZSTD_c_targetLength, 0}};

// Appends one frame of all parts, with at least one block per part. zstd chooses the parameters
// that are not given.
Result<void> append_frame(std::span<const ByteSpan> parts, Parameters parameters, Bytes& to) {
  thread_local const std::unique_ptr<ZSTD_CCtx, FreeContext> context(ZSTD_createCCtx());
  if (!context) return fail(ErrorCode::out_of_memory, "zstd: out of memory");
  ZSTD_CCtx_reset(context.get(), ZSTD_reset_session_and_parameters);
  for (const auto& [parameter, value] : parameters)
    ZSTD_CCtx_setParameter(context.get(), parameter, value);
  std::size_t total = 0, bound = 0;
  for (const ByteSpan part : parts) {
    total += part.size();
    bound += ZSTD_compressBound(part.size());
  }
  ZSTD_CCtx_setPledgedSrcSize(context.get(), total);
  const std::size_t begin = to.size();
  to.resize(begin + bound);
  ZSTD_outBuffer out{to.data() + begin, bound, 0};
  for (const ByteSpan part : parts) {
    if (part.empty()) continue;
    const bool last = total == part.size();
    total -= part.size();
    ZSTD_inBuffer in{part.data(), part.size(), 0};
    const std::size_t left =
        ZSTD_compressStream2(context.get(), &out, &in, last ? ZSTD_e_end : ZSTD_e_flush);
    if (ZSTD_isError(left)) return fail(ErrorCode::failed, "zstd: ", ZSTD_getErrorName(left));
    if (left > 0) return fail(ErrorCode::failed, "zstd: its bound is too small");
  }
  to.resize(begin + out.pos);
  return {};
}

}  // namespace

Result<void> append_stream(ByteSpan stream, int level, Bytes& to) {
  if (stream.empty()) return {};
  const std::size_t begin = to.size();
  if (auto done = append_frame({&stream, 1}, kEntropyOnly, to); !done) return done;
  // A stream of more than 3 bits per byte has no matches worth coding.
  const std::size_t entropy_size = to.size() - begin;
  if (entropy_size > stream.size() * 3 / 8) return {};
  Bytes matched;
  if (auto done = append_frame({&stream, 1}, {{ZSTD_c_compressionLevel, level}}, matched); !done)
    return done;
  if (matched.size() >= entropy_size) return {};
  to.resize(begin);
  to.insert(to.end(), matched.begin(), matched.end());
  return {};
}

Result<void> append_parts(std::span<const ByteSpan> parts, Bytes& to) {
  for (const ByteSpan part : parts)
    if (!part.empty()) return append_frame(parts, kEntropyOnly, to);
  return {};
}

Result<void> read_stream(ByteSpan& bytes, std::span<std::byte> stream) {
  if (stream.empty()) return {};
  thread_local const std::unique_ptr<ZSTD_DCtx, FreeContext> context(ZSTD_createDCtx());
  if (!context) return fail(ErrorCode::out_of_memory, "zstd: out of memory");
  const std::size_t frame = ZSTD_findFrameCompressedSize(bytes.data(), bytes.size());
  if (ZSTD_isError(frame)) return fail(ErrorCode::bad_file, "zstd: ", ZSTD_getErrorName(frame));
  const std::size_t size =
      ZSTD_decompressDCtx(context.get(), stream.data(), stream.size(), bytes.data(), frame);
  if (ZSTD_isError(size)) return fail(ErrorCode::bad_file, "zstd: ", ZSTD_getErrorName(size));
  if (size != stream.size())
    return fail(ErrorCode::bad_file, "zstd: expected ", stream.size(), " bytes, found ", size);
  bytes = bytes.subspan(frame);
  return {};
}

}  // namespace slf::codec
