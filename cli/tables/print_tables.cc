// Prints what follows from descriptions: `slf_tables schemas` is a JSON object of all of schemas/
// that are made, `slf_tables settings` and `slf_tables reports` are modules of the Python package.
#include <algorithm>
#include <cctype>
#include <cstdio>
#include <string_view>

#include "base/join.h"
#include "cli/command.h"
#include "page/site.h"
#include "slf/inspect.h"
#include "slf/measure.h"
#include "slf/merge.h"
#include "slf/player.h"
#include "slf/verify.h"

namespace slf {
namespace {

using nlohmann::json;

json schemas() {
  json all;
  cli::Run run;
  const auto app = cli::make_app(run);
  for (const auto& [name, output] : cli::output_schemas) {
    json alternatives = json::array();
    for (const auto make : output.alternatives) {
      json& schema = alternatives.emplace_back(make());
      if (output.lines || schema["type"] != "object") continue;
      json& traffic = schema["properties"]["http"] = report::schema_of<RemoteTraffic>();
      traffic["description"] = "what came from web servers, if a field was read from one";
    }
    json schema = alternatives.size() == 1 ? alternatives[0] : json{{"oneOf", alternatives}};
    schema["$schema"] = "http://json-schema.org/draft-07/schema#";
    schema["title"] = output.title;
    all[name] = std::move(schema);
  }
  all["recipe"] = recipe::schema(recipe::options());
  return all;
}

template <class T>
std::string python_type() {
  if constexpr (report::Report<T>)
    return T::kPython;
  else if constexpr (report::Optional<T>)
    return python_type<typename T::value_type>() + " | None";
  else if constexpr (std::is_same_v<T, bool>)
    return "bool";
  else if constexpr (std::is_integral_v<T>)
    return "int";
  else if constexpr (std::is_floating_point_v<T>)
    return "float";
  else if constexpr (report::Vector<T>)
    return "tuple[float, float, float]";
  else if constexpr (report::List<T>)
    return "tuple[" + python_type<std::ranges::range_value_t<T>>() + ", ...]";
  else
    return "str";
}

struct PythonMember {
  template <class T>
  void operator()(const report::Name& name, const T&, const char* help, const char* = "") {
    if (!name.python) return;
    std::string text = help;
    const std::string word = text.substr(0, text.find_first_of(" ,;:"));
    if (std::ranges::all_of(word, [](char c) { return c >= 'a' && c <= 'z'; }))
      text[0] = static_cast<char>(std::toupper(text[0]));
    out += concat("    ", name.python, ": ", python_type<report::Value<T>>(),
                  report::Pointer<T> ? " | None" : "", "\n    \"\"\"", filled(text, 96, 7, "    "),
                  ".\"\"\"\n");
  }
  std::string out;
};

template <class... Reports>
std::string python_reports() {
  std::string out =
      "\"\"\"Reports, as the library describes them.\"\"\"\n\n"
      "from __future__ import annotations\n\nfrom typing import NamedTuple\n";
  const auto add = [&]<class T>(const T& report) {
    PythonMember member;
    report.describe(member);
    out += concat("\n\nclass ", T::kPython, "(NamedTuple):\n", member.out);
  };
  (add(Reports{}), ...);
  return out;
}

}  // namespace
}  // namespace slf

int main(int count, char** arguments) {
  using namespace slf;
  const std::string_view what = count == 2 ? arguments[1] : "";
  const std::string text =
      what == "schemas"    ? schemas().dump(2) + "\n"
      : what == "settings" ? recipe::python_settings(recipe::options())
      : what == "reports"
          ? python_reports<LevelContent, FieldContent, TileAddress, ListedTile, PickedPoint,
                           Finding, VerifyReport, MeanAndMax, LevelMeasure, Measurement,
                           ImageDifference, Evaluation, BuildReport, RepackReport,
                           page::ExportReport, MergeReport, ChannelDifference, FieldDifference,
                           FrameReport>()
          : "";
  if (text.empty()) return 1;
  return std::fputs(text.c_str(), stdout) < 0 || std::fflush(stdout) != 0 ? 2 : 0;
}
