#include "base/guarded.h"

#include <exception>
#include <new>
#include <system_error>

namespace slf {

namespace {

Error error_of_the_exception() noexcept {
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

}  // namespace

Error error_of_exception(std::string_view place) noexcept {
  Error error = error_of_the_exception();
  if (place.empty()) return error;
  try {
    return {error.code, concat(place, ": ", error.message)};
  } catch (...) {
    return error;
  }
}

}  // namespace slf
