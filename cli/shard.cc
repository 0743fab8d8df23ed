// --shard and related options, which choose the part of a field that this process builds. The user
// chooses it, or the engine that started the process does.
#include <algorithm>
#include <cstdlib>
#include <sstream>
#include <tuple>

#include "base/ascii.h"
#include "cli/command.h"

namespace slf::cli {
namespace {

constexpr std::uint64_t kMaxShards = 10'000'000;

/// The value of an environment variable as a number; nullopt if it is not set or not a number.
std::optional<std::uint64_t> number_in(const char* variable) {
  const char* const text = std::getenv(variable);
  if (!text) return std::nullopt;
  const auto value = parse_number<std::uint64_t>(text);
  return value && *value <= kMaxShards ? value : std::nullopt;
}

/// An engine that starts several processes together, as seen in their environment.
struct Engine {
  std::string name;
  std::uint64_t index = 0;  ///< of this process, from 0
  std::uint64_t count = 0;
};

/// The Slurm job array to which this process belongs. Its ids may begin anywhere and have a step.
std::optional<Engine> slurm_array() {
  const auto id = number_in("SLURM_ARRAY_TASK_ID"), count = number_in("SLURM_ARRAY_TASK_COUNT"),
             first = number_in("SLURM_ARRAY_TASK_MIN");
  if (!id || !count || !first || *id < *first) return std::nullopt;
  const std::uint64_t step =
      std::max<std::uint64_t>(1, number_in("SLURM_ARRAY_TASK_STEP").value_or(1));
  return Engine{"Slurm job array", (*id - *first) / step, *count};
}

/// The engine that started this process. In a Slurm job that is not an array, mpirun has precedence
/// over Slurm's own tasks, because it numbers the processes.
std::optional<Engine> find_engine() {
  if (auto engine = slurm_array()) return engine;
  for (const auto& [name, rank, size] :
       {std::tuple{"Open MPI", "OMPI_COMM_WORLD_RANK", "OMPI_COMM_WORLD_SIZE"},
        {"PMI", "PMI_RANK", "PMI_SIZE"},
        {"Slurm tasks", "SLURM_PROCID", "SLURM_NTASKS"},
        {"Kubernetes indexed job", "JOB_COMPLETION_INDEX", "JOB_COMPLETIONS"}})
    if (const auto index = number_in(rank), count = number_in(size); index && count)
      return Engine{name, *index, *count};
  return std::nullopt;
}

Result<ShardOptions> from_engine() {
  const auto engine = find_engine();
  if (!engine)
    return fail(ErrorCode::usage,
                "--shard auto: found no engine: neither a Slurm array or task, nor ranks of Open "
                "MPI or PMI, nor an indexed job of Kubernetes with JOB_COMPLETIONS set; give K/N");
  if (engine->index >= engine->count)
    return fail(ErrorCode::usage, "--shard auto: ", engine->name, ": process ", engine->index + 1,
                " of ", engine->count, ", as of an array with gaps; give K/N");
  ShardOptions shard;
  shard.index = static_cast<std::uint32_t>(engine->index + 1);
  shard.count = static_cast<std::uint32_t>(engine->count);
  note(fmt::format("shard {}/{}, from {}", shard.index, shard.count, engine->name));
  return shard;
}

Result<ShardOptions> parse_shard(const std::string& text) {
  ShardOptions shard;
  char slash = 0;
  std::istringstream in(text);
  if (text.find_first_not_of("0123456789/") != std::string::npos ||
      !(in >> shard.index >> slash >> shard.count) || slash != '/' || !in.eof() ||
      shard.index < 1 || shard.index > shard.count || shard.count > kMaxShards)
    return fail(ErrorCode::usage, "--shard ", text, ": expected K/N with K from 1 to N, or auto");
  return shard;
}

void replace_all(std::string& text, const std::string& what, const std::string& with) {
  for (std::size_t at = 0; (at = text.find(what, at)) != std::string::npos; at += with.size())
    text.replace(at, what.size(), with);
}

}  // namespace

void ShardArguments::add_to(CLI::App& command) {
  const OptionGroup group(command, kShardGroup);
  command
      .add_option("--shard", shard,
                  "Build the K-th of N parts of equal work; auto: as Slurm, MPI or Kubernetes\n"
                  "says; {K} and {N} in the output's name stand for the numbers")
      ->type_name("K/N");
  add_levels(command, "--only-levels", levels, "Build these levels only, as a part of the field");
  add_file(command, "--coarser", coarser,
           "Part of this field with all coarser levels, from which the next one is\n"
           "predicted; without it, a part builds the coarser tiles that it needs itself",
           kFieldFile);
}

Result<ShardOptions> ShardArguments::options() const {
  auto options = shard == "auto"  ? from_engine()
                 : !shard.empty() ? parse_shard(shard)
                                  : Result<ShardOptions>(ShardOptions{});
  if (!options) return options;
  if (levels) options->first_level = levels->first, options->last_level = levels->last;
  options->coarser = coarser;
  return options;
}

std::string name_of_part(std::string path, const ShardOptions& shard) {
  const std::string count = std::to_string(shard.count);
  replace_all(path, "{K}", fmt::format("{:0{}}", shard.index, count.size()));
  replace_all(path, "{N}", count);
  return path;
}

}  // namespace slf::cli
