#include <fmt/format.h>

#include <cctype>
#include <utility>

#include "cli/reference/model.h"
#include "cli/reference/prose.h"

namespace slf::cli::reference {
namespace {

constexpr std::pair<int, const char*> kExitCodes[] = {
    {0, "Done."},
    {1, "An argument is wrong or contradicts another."},
    {2, "Input or output failed: missing, permission, disk full."},
    {3, "A file is damaged, truncated or not what it claims to be."},
    {4, "A correct request could not be carried out at run time."},
    {5, "Valid, but not supported by this version."},
    {7, "A comparison found a difference."},
};

/// Escapes text so that troff prints it literally.
std::string literal(const std::string& text) {
  std::string out;
  for (const char c : text) switch (c) {
      case '\\':
        out += "\\e";
        break;
      case '-':
        out += "\\-";
        break;
      case '\'':
        out += "\\(aq";
        break;
      case '^':
        out += "\\(ha";
        break;
      case '~':
        out += "\\(ti";
        break;
      default:
        out += c;
    }
  // troff would read a dot at the start of a line as a request.
  return out.starts_with('.') ? "\\&" + out : out;
}

std::string bold(const std::string& text) { return "\\fB" + literal(text) + "\\fR"; }
std::string italic(const std::string& text) { return "\\fI" + literal(text) + "\\fR"; }

/// Sets names of options and of other pages in bold.
std::string marked(const std::string& text) {
  std::string out, word;
  const auto flush = [&] {
    const std::size_t end = word.find_last_not_of(".,;:)") + 1;
    if (word.starts_with("--") && end > 2)
      out += bold(word.substr(0, end)) + literal(word.substr(end));
    else if (const auto page = word.find("(1)");
             word.starts_with("slf") && page != std::string::npos)
      out += bold(word.substr(0, page)) + literal(word.substr(page));
    else
      out += literal(word);
    word.clear();
  };
  for (const char c : text)
    if (c == ' ')
      flush(), out += c;
    else
      word += c;
  flush();
  return out.starts_with('.') ? "\\&" + out : out;
}

std::string upper(std::string text) {
  for (char& c : text) c = static_cast<char>(std::toupper(static_cast<unsigned char>(c)));
  return text;
}

std::string header(const std::string& page) {
  return fmt::format(
      ".\\\" Generated from the command line of slf. Do not edit.\n"
      ".TH {} 1 \"\" \"slf {}\" \"slf manual\"\n.nh\n.ad l\n",
      literal(upper(page)), SLF_VERSION);
}

std::string section(const char* title) { return fmt::format(".SH {}\n", title); }

/// A description in the form that follows "slf-build - ", such as "build a field".
std::string after_dash(std::string text) {
  if (text.size() > 1 && std::islower(static_cast<unsigned char>(text[1])))
    text[0] = static_cast<char>(std::tolower(static_cast<unsigned char>(text[0])));
  return literal(text);
}

std::string value_of(const Argument& a) {
  std::string value = italic(a.value);
  if (a.repeated) value += a.list ? "[," + italic(a.value) + "...]" : " ...";
  return value;
}

/// The paragraph of an argument: its names and description.
std::string entry(const Argument& a) {
  std::string names;
  for (const auto& name : a.names) {
    if (!names.empty()) names += ", ";
    names += a.positional ? italic(name) : bold(name);
  }
  if (!a.positional && !a.value.empty()) names += " " + value_of(a);
  std::string text = marked(a.description);
  if (!text.ends_with('.')) text += '.';
  if (a.closed) {
    std::string choices;
    for (const auto& choice : a.choices) choices += (choices.empty() ? "" : ", ") + bold(choice);
    text += " One of: " + choices + ".";
  }
  if (!a.range.empty() && a.range.find('[') != std::string::npos)
    text += " Range: " + literal(a.range.substr(a.range.find('['))) + ".";
  if (!a.initial.empty()) text += " Default: " + bold(a.initial) + ".";
  if (a.required && !a.positional) text += " Required.";
  return ".TP\n" + names + "\n" + text + "\n";
}

std::string paragraphs(const Prose& text) {
  std::string out;
  for (const char* paragraph : text.paragraphs)
    out += (out.empty() ? "" : ".PP\n") + marked(paragraph) + "\n";
  return out;
}

std::string examples(const Prose& text) {
  std::string out = section("EXAMPLES");
  for (const Example& example : text.examples)
    out += fmt::format(".TP\n{}:\n{}\n", literal(example.purpose), bold(example.line));
  return out;
}

/// The variables that slf reads; `shards`: with those of `slf build --shard auto`. doc/commands.md
/// also lists those of scripts and tests.
std::string environment(bool shards) {
  std::string out = section("ENVIRONMENT");
  const auto add = [&](const char* names, const char* effect) {
    out += ".TP\n" + bold(names) + "\n" + marked(effect) + "\n";
  };
  if (shards) {
    add("SLURM_ARRAY_TASK_ID, SLURM_ARRAY_TASK_COUNT, SLURM_ARRAY_TASK_MIN, SLURM_ARRAY_TASK_STEP",
        "For slf-build(1) with --shard auto: the shard's number in a Slurm job array.");
    add("OMPI_COMM_WORLD_RANK, OMPI_COMM_WORLD_SIZE; PMI_RANK, PMI_SIZE; SLURM_PROCID, "
        "SLURM_NTASKS; JOB_COMPLETION_INDEX, JOB_COMPLETIONS",
        "The same outside of an array: the first pair that is set is used. They are variables of "
        "Open MPI, PMI, srun, and indexed jobs of Kubernetes.");
  }
  add("TMPDIR",
      "Folder for temporary files, /tmp by default: what is read of a field over HTTP, and packed "
      "volumes that cannot be unpacked while they are read.");
  return out + ".PP\nlibcurl reads its own variables, such as https_proxy and no_proxy.\n";
}

std::string closing(const std::vector<std::string>& see_also, bool shards) {
  std::string out = section("EXIT STATUS");
  for (const auto& [code, meaning] : kExitCodes)
    out += fmt::format(".TP\n.B {}\n{}\n", code, literal(meaning));
  out += environment(shards) + section("FILES") + ".TP\n" + italic("FILE.slf") +
         "\nA field: one file, described byte by byte in FORMAT.md.\n";
  out += section("SEE ALSO");
  for (std::size_t i = 0; i < see_also.size(); ++i)
    out += fmt::format(".BR {} (1){}\n", literal(see_also[i]), i + 1 < see_also.size() ? "," : "");
  return out;
}

}  // namespace

std::string command_manual(const Program& program, const Command& command) {
  const Prose& text = prose(command.name);
  const std::string page = "slf-" + command.name;
  std::string out = header(page) + section("NAME") + literal(page) + " \\- " +
                    after_dash(command.description) + "\n";
  out +=
      section("SYNOPSIS") + ".B slf " + literal(command.name) + "\n[" + italic("OPTIONS") + "]\n";
  for (const Argument& a : command.arguments)
    if (a.positional) out += italic(a.names.front()) + (a.repeated ? " ...\n" : "\n");
  for (const Argument& a : command.arguments)
    if (!a.positional && a.required) out += bold(a.names.front()) + " " + value_of(a) + "\n";
  out += section("DESCRIPTION") + paragraphs(text);
  if (!command.notes.empty()) out += ".PP\n" + marked(command.notes) + "\n";
  out += section("ARGUMENTS");
  for (const Argument& a : command.arguments)
    if (a.positional) out += entry(a);
  out += section("OPTIONS");
  for (const std::string& group : command.groups()) {
    if (group != "Options") out += ".SS " + literal(group) + "\n";
    for (const Argument& a : command.arguments)
      if (!a.positional && a.group == group) out += entry(a);
  }
  out += ".SS Every command\n";
  for (const Argument& a : program.global.arguments)
    if (a.names.back() != "--version" && a.names.back() != "--help") out += entry(a);
  out += examples(text);
  std::vector<std::string> others{"slf"};
  for (const Command& other : program.commands)
    if (other.name != command.name) others.push_back("slf-" + other.name);
  const bool builds = command.name == "build";
  return out + closing(others, builds);
}

std::string program_manual(const Program& program) {
  const Prose& text = prose("");
  std::string out = header("slf") + section("NAME") +
                    "slf \\- build, store and render sphere light fields\n" + section("SYNOPSIS") +
                    ".B slf\n" + italic("COMMAND") + "\n[" + italic("OPTIONS") +
                    "]\n.br\n.B slf\n" + italic("COMMAND") + "\n" + bold("--help") + "\n" +
                    section("DESCRIPTION") + paragraphs(text) + section("COMMANDS");
  std::vector<std::string> pages;
  for (const Command& command : program.commands) {
    pages.push_back("slf-" + command.name);
    out +=
        fmt::format(".TP\n.BR {} (1)\n{}.\n", literal(pages.back()), literal(command.description));
  }
  out += section("OPTIONS");
  for (const Argument& a : program.global.arguments) out += entry(a);
  return out + examples(text) + closing(pages, true);
}

}  // namespace slf::cli::reference
