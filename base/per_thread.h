// per_thread(): an object of each thread. Unlike a thread_local one it throws where memory is
// short: glibc ends the program if it cannot note the destructor of that.
#pragma once

#ifndef __wasm__
#include <pthread.h>
#endif

#include <memory>
#include <new>

namespace slf {

/// The calling thread's T of this call, made when it is first called and destroyed with the thread:
/// `auto& scratch = per_thread<Scratch>([] {});`. Each lambda has a type of its own.
template <class T, class Call>
[[nodiscard]] T& per_thread(Call) {
#ifdef __wasm__  // one thread
  static T own;
  return own;
#else
  static const pthread_key_t key = [] {
    pthread_key_t made{};
    if (pthread_key_create(&made, [](void* own) { delete static_cast<T*>(own); }) != 0)
      throw std::bad_alloc();
    return made;
  }();
  if (void* const own = pthread_getspecific(key)) return *static_cast<T*>(own);
  auto own = std::make_unique<T>();
  if (pthread_setspecific(key, own.get()) != 0) throw std::bad_alloc();
  return *own.release();
#endif
}

}  // namespace slf
