// How a module and JavaScript exchange bytes and texts (page/web/module.js). Part of each module.
#pragma once

#include <string>
#include <utility>

#include "base/bytes.h"
#include "slf/error.h"

#define SLF_EXPORT(name) extern "C" __attribute__((export_name(#name)))

namespace slf {

enum Status : int { kDone = 0, kNeedsBytes = 1, kFailed = 2 };

struct Exchange {
  std::string text{};  ///< a message or a description
  Bytes buffer{};      ///< from JavaScript
};

inline Exchange& exchange() {
  static Exchange instance;
  return instance;
}

inline int failed(const Error& error) {
  exchange().text = error.message;
  return kFailed;
}

/// Takes the content of the buffer.
inline Bytes taken_buffer() { return std::exchange(exchange().buffer, {}); }

}  // namespace slf

SLF_EXPORT(slf_buffer) std::byte* slf_buffer(std::size_t size) {
  slf::exchange().buffer.resize(size);
  return slf::exchange().buffer.data();
}
SLF_EXPORT(slf_text) const char* slf_text() { return slf::exchange().text.data(); }
SLF_EXPORT(slf_text_size) std::size_t slf_text_size() { return slf::exchange().text.size(); }

/// Registers what a thread destroys when it ends. The only thread here does not end.
extern "C" int __cxa_thread_atexit(void (*)(void*), void*, void*) { return 0; }
