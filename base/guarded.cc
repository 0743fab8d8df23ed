#include "base/guarded.h"

#include <exception>
#include <new>

namespace slf {

Error error_of_exception() noexcept {
  try {
    throw;
  } catch (const std::bad_alloc&) {
  } catch (const std::exception& exception) {
    try {
      return {ErrorCode::failed, std::string("unexpected: ") + exception.what()};
    } catch (const std::bad_alloc&) {
    }
  } catch (...) {
    return {ErrorCode::failed, "unknown error"};
  }
  return {ErrorCode::out_of_memory,
          "out of memory"};  // short: a std::string holds it without allocating
}

}  // namespace slf
