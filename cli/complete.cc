// Completion in shells. `slf __complete WORD...` prints what may stand in the place of the last
// word, a line each, with a description after a tab. Where a file is wanted, it prints ":files",
// ":files ENDING" or ":folders", and the shell does the rest (cli/completion).
#include "cli/command.h"

namespace slf::cli {
namespace {

/// The values to offer. CLI11 describes those of choose() as "TEXT:{u8,half}", and names that stand
/// for values as "{a->0,b->1} OR {0,1}".
std::vector<std::string> choices_of(const std::string& type) {
  if (type == kCodec)
    return {"predictive:75", "predictive:90", "predictive:lossless", "raw", "zstd", "zstd:9",
            "jpeg:75",       "jpeg:90"};
  const std::size_t open = type.find('{');
  if (open == std::string::npos) return {};
  auto choices = CLI::detail::split(type.substr(open + 1, type.find('}') - open - 1), ',');
  for (std::string& choice : choices) choice.resize(std::min(choice.size(), choice.find("->")));
  return choices;
}

class Completion {
 public:
  explicit Completion(std::string word) : word_(std::move(word)) {}

  void offer(const std::string& text, std::string description = "") const {
    if (!text.starts_with(word_)) return;
    std::ranges::replace(description, '\n', ' ');
    print("{}\t{}\n", text, description.substr(0, description.find(';')));
  }

  void offer_options(const CLI::App& app) const {
    for (const CLI::Option* option : app.get_options({}))
      if (!option->get_positional() && !option->get_group().empty()) {
        for (const std::string& name : option->get_snames())
          offer("-" + name, option->get_description());
        for (const std::string& name : option->get_lnames())
          offer("--" + name, option->get_description());
      }
  }

  /// The values of an option, after `before`, which the word begins with.
  void offer_values(const CLI::Option& option, std::string before) const {
    const std::string type = option.get_type_name();
    if (type == kFolder) return print_text(":folders\n");
    if (type == kAnyFile) return print_text(":files\n");
    if (type.starts_with(kAnyFile))
      return print(":files {}\n", type.substr(std::string_view(kAnyFile).size()));
    // After a comma, one more.
    if (option.get_delimiter() == ',')
      before = word_.substr(0, std::max(before.size(), word_.rfind(',') + 1));
    for (const std::string& choice : choices_of(type)) offer(before + choice);
  }

 private:
  std::string word_;
};

}  // namespace

void complete(const CLI::App& app, std::vector<std::string> words) {
  const std::string word = words.empty() ? "" : words.back();
  const Completion completion(word);
  if (!words.empty()) words.pop_back();
  const CLI::App* command = nullptr;
  for (const std::string& name : words)
    for (const CLI::App* known : app.get_subcommands({}))
      if (!command && known->get_name() == name) command = known;
  if (!command) {
    for (const CLI::App* known : app.get_subcommands({}))
      completion.offer(known->get_name(), known->get_description());
    return completion.offer_options(app);
  }
  const auto option_of = [&](const std::string& name) {
    const CLI::Option* option = command->get_option_no_throw(name);
    if (!option) option = app.get_option_no_throw(name);
    return option && option->get_items_expected_max() > 0 ? option : nullptr;
  };
  const std::size_t equals = word.starts_with("--") ? word.find('=') : std::string::npos;
  if (equals != std::string::npos) {
    if (const auto* option = option_of(word.substr(0, equals)))
      completion.offer_values(*option, word.substr(0, equals + 1));
  } else if (const auto* option =
                 words.back().starts_with('-') ? option_of(words.back()) : nullptr) {
    completion.offer_values(*option, "");
  } else if (word.starts_with('-')) {
    completion.offer_options(*command);
    completion.offer_options(app);
  } else {
    for (const CLI::Option* argument : command->get_options({}))
      if (argument->get_positional()) return completion.offer_values(*argument, "");
  }
}

}  // namespace slf::cli
