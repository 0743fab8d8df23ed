// Uses the installed headers and libraries of slf: opens a field that is not there, and learns so.
#include <field/field.h>
#include <cstdio>

int main() {
  const auto field = slf::Field::open("missing.slf");
  if (field || field.error().code != slf::ErrorCode::io) return 1;
  std::puts(field.error().message.c_str());
  return 0;
}
