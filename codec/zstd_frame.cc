#include "codec/zstd_frame.h"

#include <zstd.h>

#include <memory>
#include <utility>

#include "base/per_thread.h"
#include "base/try.h"

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

// Appends a frame. zstd chooses the parameters that are not given.
Result<void> append_frame(ByteSpan stream, Parameters parameters, Bytes& to) {
  auto& context = per_thread<std::unique_ptr<ZSTD_CCtx, FreeContext>>([] {});
  if (!context) context.reset(ZSTD_createCCtx());
  if (!context) return fail(ErrorCode::out_of_memory, "zstd: out of memory");
  ZSTD_CCtx_reset(context.get(), ZSTD_reset_session_and_parameters);
  for (const auto& [parameter, value] : parameters)
    ZSTD_CCtx_setParameter(context.get(), parameter, value);
  const std::size_t begin = to.size(), bound = ZSTD_compressBound(stream.size());
  to.resize(begin + bound);
  const std::size_t size =
      ZSTD_compress2(context.get(), to.data() + begin, bound, stream.data(), stream.size());
  if (ZSTD_isError(size)) return fail(ErrorCode::failed, "zstd: ", ZSTD_getErrorName(size));
  to.resize(begin + size);
  return {};
}

}  // namespace

Result<void> append_stream(ByteSpan stream, int level, Bytes& to) {
  if (stream.empty()) return {};
  const std::size_t begin = to.size();
  SLF_TRY(append_frame(stream, kEntropyOnly, to));
  // A stream of more than 3 bits per byte has no matches worth coding.
  const std::size_t entropy_size = to.size() - begin;
  if (entropy_size > stream.size() * 3 / 8) return {};
  Bytes matched;
  SLF_TRY(append_frame(stream, {{ZSTD_c_compressionLevel, level}}, matched));
  if (matched.size() >= entropy_size) return {};
  to.resize(begin);
  to.insert(to.end(), matched.begin(), matched.end());
  return {};
}

Result<void> read_stream(ByteSpan& bytes, std::span<std::byte> stream) {
  if (stream.empty()) return {};
  auto& context = per_thread<std::unique_ptr<ZSTD_DCtx, FreeContext>>([] {});
  if (!context) context.reset(ZSTD_createDCtx());
  if (!context) return fail(ErrorCode::out_of_memory, "zstd: out of memory");
  const std::size_t frame = ZSTD_findFrameCompressedSize(bytes.data(), bytes.size());
  if (ZSTD_isError(frame)) return bad_file("zstd", ZSTD_getErrorName(frame));
  const std::size_t size =
      ZSTD_decompressDCtx(context.get(), stream.data(), stream.size(), bytes.data(), frame);
  if (ZSTD_isError(size)) return bad_file("zstd", ZSTD_getErrorName(size));
  if (size != stream.size())
    return bad_file("zstd", "expected ", stream.size(), " bytes, found ", size);
  bytes = bytes.subspan(frame);
  return {};
}

}  // namespace slf::codec
