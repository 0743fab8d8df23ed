#include "view/bundle.h"

#include <algorithm>
#include <map>
#include <regex>
#include <set>
#include <sstream>
#include <string_view>

#include "view/page.h"

namespace slf::view {
namespace {

constexpr std::string_view kWorker = "worker.js", kWorkerImports = "module.js";

/// The name of a module, without ".js".
std::string stem(std::string_view file) { return std::string(file.substr(0, file.find('.'))); }

/// A module as a part of a classic script.
struct Module {
  std::string text;  ///< without imports and exports
  std::string uses;  ///< what it imports, as declarations
};

/// Takes the imports, comments and most line breaks out of a module, and adds the imported names to
/// `used`, by module.
Module take_apart(const PageFile& file, std::map<std::string, std::set<std::string>>& used) {
  static const std::regex import(R"(import \{([^}]*)\} from '\./([\w.]+)';)");
  static const std::regex name(R"((\w+)(?: as \w+)?)"), renamed(" as "), declaration("^export ");
  Module result;
  std::istringstream lines{std::string(file.bytes)};
  for (std::string line; std::getline(lines, line);) {
    std::smatch found;
    line.erase(0, line.find_first_not_of(' '));
    line.erase(std::min(line.find("  // "), line.size()));
    line.erase(line.find_last_not_of(' ') + 1);
    if (line.empty() || line.starts_with("//")) continue;
    if (!std::regex_match(line, found, import)) {
      result.text += std::regex_replace(line, declaration, "");
      if (std::string_view(";{,([").find(line.back()) == std::string_view::npos)
        result.text += '\n';
      continue;
    }
    const std::string names = found[1], from = found[2];
    for (std::sregex_iterator at(names.begin(), names.end(), name), end; at != end; ++at)
      used[from].insert((*at)[1]);
    result.uses +=
        "const {" + std::regex_replace(names, renamed, ": ") + "} = modules." + stem(from) + ";\n";
  }
  return result;
}

}  // namespace

std::string page_script(const std::string& members) {
  std::map<std::string, std::set<std::string>> used;
  std::map<std::string_view, Module> modules;
  for (const PageFile& file : page_files())
    if (file.name.ends_with(".js")) modules[file.name] = take_apart(file, used);
  const auto exports = [&](std::string_view name) {
    std::string exported;
    for (const std::string& one : used[std::string(name)]) exported += one + ", ";
    return "return {" + exported + "};\n}";
  };
  // What the worker imports, the page takes from the worker's script.
  std::string script = "globalThis.slfInside = {worker: function (self) {\n'use strict';\n" +
                       modules[kWorkerImports].text + modules[kWorker].text +
                       exports(kWorkerImports) + ",\n" + members +
                       "};\n(() => {\n'use strict';\nconst modules = {" + stem(kWorkerImports) +
                       ": slfInside.worker({})};\n";
  for (const PageFile& file : page_files()) {  // each after those that it imports
    if (!file.name.ends_with(".js") || file.name == kWorker || file.name == kWorkerImports)
      continue;
    const Module& module = modules[file.name];
    script += "modules." + stem(file.name) + " = (() => {\n" + module.uses + module.text +
              exports(file.name) + ")();\n";
  }
  return script + "})();\n";
}

std::string module_string() {
  for (const PageFile& file : page_files())
    if (file.name == kModuleFile) return "'" + base64(file.bytes) + "'";
  return "''";
}

std::string base64(std::string_view bytes) {
  constexpr std::string_view kDigits =
      "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string text;
  text.reserve((bytes.size() + 2) / 3 * 4);
  for (std::size_t at = 0; at < bytes.size(); at += 3) {
    const std::size_t count = std::min<std::size_t>(3, bytes.size() - at);
    std::uint32_t word = 0;
    for (std::size_t i = 0; i < 3; ++i)
      word = word << 8 | (i < count ? static_cast<unsigned char>(bytes[at + i]) : 0u);
    for (std::size_t i = 0; i < 4; ++i)
      text += i <= count ? kDigits[word >> (18 - 6 * i) & 63] : '=';
  }
  return text;
}

}  // namespace slf::view
