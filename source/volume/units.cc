#include "source/volume/units.h"

#include <string>

#include "base/ascii.h"

namespace slf::volume_io {
namespace {

struct Unit {
  std::string_view name;
  double micrometres;
};

constexpr Unit kSymbols[] = {{"Ym", 1e30},
                             {"Zm", 1e27},
                             {"Em", 1e24},
                             {"Pm", 1e21},
                             {"Tm", 1e18},
                             {"Gm", 1e15},
                             {"Mm", 1e12},
                             {"km", 1e9},
                             {"hm", 1e8},
                             {"dam", 1e7},
                             {"m", 1e6},
                             {"dm", 1e5},
                             {"cm", 1e4},
                             {"mm", 1e3},
                             {"\u00b5m", 1},
                             {"\u03bcm", 1},
                             {"\xb5m", 1},          // in Latin-1,
                             {"\u00c2\u00b5m", 1},  // and in UTF-8 that was read as such
                             {"um", 1},
                             {"nm", 1e-3},
                             {"pm", 1e-6},
                             {"fm", 1e-9},
                             {"am", 1e-12},
                             {"zm", 1e-15},
                             {"ym", 1e-18},
                             {"\u00c5", 1e-4},
                             {"\u212b", 1e-4},
                             {"thou", 25.4},
                             {"mil", 25.4},
                             {"li", 25400.0 / 12},
                             {"in", 25400},
                             {"ft", 304800},
                             {"yd", 914400},
                             {"mi", 1609344e3},
                             {"pt", 25400.0 / 72},
                             {"ua", 149597870700e6},
                             {"ly", 9460730472580800e6},
                             {"pc", 3.0856775814913673e22}};

/// In small letters; an s may follow.
constexpr Unit kNames[] = {
    {"micron", 1},       {"micrometer", 1},   {"micrometre", 1},   {"\\u00b5m", 1},
    {"nanometer", 1e-3}, {"nanometre", 1e-3}, {"angstrom", 1e-4},  {"millimeter", 1e3},
    {"millimetre", 1e3}, {"centimeter", 1e4}, {"centimetre", 1e4}, {"meter", 1e6},
    {"metre", 1e6},      {"inch", 25400},     {"inche", 25400},    {"\"", 25400},
    {"nm", 1e-3},        {"um", 1},           {"mm", 1e3},         {"cm", 1e4}};

}  // namespace

std::optional<double> micrometres(std::string_view unit) {
  unit = trim(unit);
  for (const Unit& symbol : kSymbols)
    if (unit == symbol.name) return symbol.micrometres;
  const std::string small = lower_case(unit);
  for (const Unit& known : kNames)
    if (small == known.name ||
        (small.ends_with('s') && small.substr(0, small.size() - 1) == known.name))
      return known.micrometres;
  return std::nullopt;
}

}  // namespace slf::volume_io
