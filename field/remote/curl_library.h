// libcurl, loaded when it is first used: most programs read local files only, and libcurl brings
// some thirty libraries with it.
#pragma once

#include <curl/curl.h>

#include "slf/error.h"

namespace slf {

// clang-format off
#define SLF_CURL_FUNCTIONS(F)                                                                      \
  F(global_init) F(free) F(slist_append) F(slist_free_all)                                         \
  F(easy_init) F(easy_reset) F(easy_cleanup) F(easy_setopt) F(easy_getinfo) F(easy_header)         \
  F(easy_strerror)                                                                                 \
  F(multi_init) F(multi_cleanup) F(multi_add_handle) F(multi_remove_handle)                        \
  F(multi_perform) F(multi_info_read) F(multi_poll)                                                \
  F(url) F(url_cleanup) F(url_get) F(url_set)
// clang-format on

/// The functions of libcurl, without "curl_".
struct CurlLibrary {
// NOLINTNEXTLINE(bugprone-macro-parentheses): a name
#define SLF_CURL_MEMBER(name) decltype(&curl_##name) name;
  SLF_CURL_FUNCTIONS(SLF_CURL_MEMBER)
#undef SLF_CURL_MEMBER
};

/// Empty until load_curl() has succeeded.
extern const CurlLibrary& curl;

/// Loads and initialises libcurl at the first call, which decides for all others. It stays loaded.
/// Errors: unsupported if it is not installed. Thread-safety: any thread.
[[nodiscard]] Result<void> load_curl();

}  // namespace slf
