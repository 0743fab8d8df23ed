// Prints what follows from the table of options: `slf_tables schema` is schemas/recipe.json,
// `slf_tables python` is the package's _settings.py.
#include <cstdio>
#include <string_view>

#include "source/recipe/options.h"

int main(int count, char** arguments) {
  const std::string_view what = count == 2 ? arguments[1] : "";
  if (what != "schema" && what != "python") return 1;
  const auto options = slf::recipe::options();
  const std::string text = what == "schema" ? slf::recipe::schema(options).dump(2) + "\n"
                                            : slf::recipe::python_settings(options);
  return std::fputs(text.c_str(), stdout) < 0 || std::fflush(stdout) != 0 ? 2 : 0;
}
