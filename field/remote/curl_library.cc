#include "field/remote/curl_library.h"

#include <dlfcn.h>

namespace slf {
namespace {

constinit CurlLibrary library{};

Result<void> load() {
  void* handle = dlopen("libcurl.so.4", RTLD_NOW);
  if (handle == nullptr)
    return fail(ErrorCode::unsupported, "reading over HTTP needs libcurl (Debian's package ",
                "libcurl4): ", dlerror());
#define SLF_CURL_LOAD(name)                                                              \
  library.name = reinterpret_cast<decltype(library.name)>(dlsym(handle, "curl_" #name)); \
  if (library.name == nullptr)                                                           \
    return fail(ErrorCode::unsupported, "libcurl.so.4 is too old: ", dlerror());
  SLF_CURL_FUNCTIONS(SLF_CURL_LOAD)
#undef SLF_CURL_LOAD
  if (const CURLcode ready = library.global_init(CURL_GLOBAL_DEFAULT); ready != CURLE_OK)
    return fail(ErrorCode::failed, "libcurl: ", library.easy_strerror(ready));
  return {};
}

}  // namespace

constinit const CurlLibrary& curl = library;

Result<void> load_curl() {
  static const Result<void> loaded = load();
  return loaded;
}

}  // namespace slf
