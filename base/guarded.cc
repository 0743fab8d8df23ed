#include "base/guarded.h"

#include <exception>
#include <new>
#include <system_error>

namespace slf {

Error error_of_exception() noexcept {
  try {
    throw;
  } catch (const std::bad_alloc&) {
  } catch (const std::exception& exception) {
    try {
      const auto* const system = dynamic_cast<const std::system_error*>(&exception);
      if (system && system->code() == std::errc::resource_unavailable_try_again)
        return {ErrorCode::failed,
                "the system starts no more threads; raise its limit (ulimit -u)"};
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
