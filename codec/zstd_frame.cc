#include "codec/zstd_frame.h"

#include <zstd.h>

#include <memory>

namespace slf::codec {
namespace {

struct FreeContext {
  void operator()(ZSTD_CCtx* context) const { ZSTD_freeCCtx(context); }
  void operator()(ZSTD_DCtx* context) const { ZSTD_freeDCtx(context); }
};

}  // namespace

Result<void> append_zstd(ByteSpan plain, int level, Bytes& to) {
  thread_local const std::unique_ptr<ZSTD_CCtx, FreeContext> context(ZSTD_createCCtx());
  if (!context) return fail(ErrorCode::failed, "zstd: out of memory");
  const std::size_t begin = to.size();
  to.resize(begin + ZSTD_compressBound(plain.size()));
  const std::size_t size = ZSTD_compressCCtx(context.get(), to.data() + begin, to.size() - begin,
                                             plain.data(), plain.size(), level);
  if (ZSTD_isError(size)) return fail(ErrorCode::failed, "zstd: ", ZSTD_getErrorName(size));
  to.resize(begin + size);
  return {};
}

Result<void> read_zstd(ByteSpan frame, std::span<std::byte> plain) {
  thread_local const std::unique_ptr<ZSTD_DCtx, FreeContext> context(ZSTD_createDCtx());
  if (!context) return fail(ErrorCode::failed, "zstd: out of memory");
  const std::size_t size =
      ZSTD_decompressDCtx(context.get(), plain.data(), plain.size(), frame.data(), frame.size());
  if (ZSTD_isError(size)) return fail(ErrorCode::bad_file, "zstd: ", ZSTD_getErrorName(size));
  if (size != plain.size())
    return fail(ErrorCode::bad_file, "zstd: expected ", plain.size(), " bytes, found ", size);
  return {};
}

}  // namespace slf::codec
