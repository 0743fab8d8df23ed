// What libjpeg does when it fails, for the files of this room that call it.
#pragma once

#include <csetjmp>
#include <cstddef>
#include <cstdio>

// They need FILE and size_t declared before them.
#include <jerror.h>
#include <jpeglib.h>

namespace slf::codec {

// libjpeg reports an error by calling us, and we must not return to it: we jump out. No object with
// a destructor may live in the frames between setjmp and the jump.
struct ErrorManager {
  jpeg_error_mgr base;
  std::jmp_buf jump;
  char message[JMSG_LENGTH_MAX];
};

[[noreturn]] inline void raise_error(j_common_ptr info) {
  auto* manager = reinterpret_cast<ErrorManager*>(info->err);
  manager->base.format_message(info, manager->message);
  std::longjmp(manager->jump, 1);
}

// Warnings (level < 0) mean damage; the other levels are traces.
inline void refuse_warning(j_common_ptr info, int level) {
  if (level < 0) raise_error(info);
}

inline void ignore_message(j_common_ptr) {}

inline jpeg_error_mgr* init(ErrorManager& manager) {
  jpeg_std_error(&manager.base);
  manager.base.error_exit = raise_error;
  manager.base.emit_message = refuse_warning;
  manager.base.output_message = ignore_message;
  return &manager.base;
}

}  // namespace slf::codec
