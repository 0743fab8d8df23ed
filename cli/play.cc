#include <algorithm>
#include <chrono>
#include <cmath>
#include <filesystem>
#include <future>
#include <map>
#include <numeric>
#include <optional>
#include <thread>

#include "base/try.h"
#include "cli/command.h"
#include "field/measure/process_memory.h"
#include "slf/camera.h"
#include "slf/image.h"
#include "slf/player.h"
#include "slf/remote.h"

namespace slf::cli {
namespace {

using Clock = std::chrono::steady_clock;

struct PlayArguments {
  FieldArguments field;
  std::string path;
  std::vector<double> orbit{0, 20, 3};
  PixelSize size{512, 512};
  double turns = 1, seconds = 12, fps = 30;
  std::vector<Loading> loading{Loading::ahead};
  unsigned horizon = PlayOptions{}.horizon;
  bool cold = false;
  std::string states;  // "FIRST:END"; empty: one state
  std::string frames, preview;
  DrawArguments draw;
  bool force = false, json = false;

  [[nodiscard]] Result<CameraPath> camera_path(const Sphere& sphere) const {
    if (path.empty())
      return CameraPath::orbit(sphere, orbit[0], orbit[1], orbit[2], turns, seconds);
    return CameraPath::read(path, sphere);
  }
};

/// Writes the frames to a folder of PNGs, an animation, or both.
class FrameFiles {
 public:
  static Result<FrameFiles> make(const PlayArguments& a) {
    FrameFiles pictures;
    pictures.inputs_ = a.draw.inputs(a.field);
    pictures.inputs_.push_back(a.path);
    if (!a.preview.empty()) {
      SLF_TRY(refuse_overwrite(a.preview, a.force, pictures.inputs_));
      pictures.animation_.emplace(a.preview, 1 / a.fps);
    }
    if (!a.frames.empty()) {
      std::error_code error;
      std::filesystem::create_directories(a.frames, error);
      if (error)
        return fail(ErrorCode::io, a.frames, ": cannot make the folder: ", error.message());
      if (!a.force && !std::filesystem::is_empty(a.frames, error))
        return misuse(a.frames, "not empty; -f overwrites the frames in it");
      pictures.folder_ = a.frames;
    }
    return pictures;
  }
  [[nodiscard]] Result<void> add(std::size_t frame, const Image& image) {
    if (animation_) SLF_TRY(animation_->add(image));
    if (folder_.empty()) return {};
    const std::string file = (folder_ / fmt::format("{:05}.png", frame)).string();
    SLF_TRY(refuse_overwrite(file, /*force=*/true, inputs_));
    return write_image(file, image);
  }
  [[nodiscard]] Result<void> close() { return animation_ ? animation_->close() : Result<void>(); }
  [[nodiscard]] bool enabled() const { return animation_ || !folder_.empty(); }

 private:
  std::vector<std::string> inputs_;
  std::optional<AnimationWriter> animation_;
  std::filesystem::path folder_;
};

/// What frames have in common.
struct Summary {
  std::size_t frames = 0, late = 0;
  double mean_ms = 0, p95_ms = 0, worst_ms = 0;
  double mean_full = 0, least_full = 1, hit_rate = 0;
  std::uint64_t loads = 0, load_bytes = 0;
  std::vector<double> level_shares{};
  ResidentMemory peak{};

  void describe(auto& member) const {
    constexpr const char* kNotNegative = R"("minimum": 0)";
    member("frames", frames, "drawn");
    member("late", late, "frames");
    member("mean_ms", mean_ms, "milliseconds", kNotNegative);
    member("p95_ms", p95_ms, "milliseconds", kNotNegative);
    member("worst_ms", worst_ms, "milliseconds", kNotNegative);
    member("full_share", mean_full, "pixels drawn at the full level, 0 to 1");
    member("least_full_share", least_full, "of a frame");
    member("level_shares", level_shares, "of the pixels, by the level that they were drawn from");
    member("hit_rate", hit_rate, "tiles found in the cache, 0 to 1");
    member("loads", loads, "tiles loaded");
    member("load_bytes", load_bytes, "of them, and of tiles decoded to predict them");
    member("rss_anon_peak_bytes", peak.anonymous, "anonymous memory");
    member("rss_file_peak_bytes", peak.file, "mapped files");
  }

  Summary() = default;
  Summary(const std::vector<FrameReport>& reports, double period) : frames(reports.size()) {
    std::vector<double> ms;
    std::uint64_t tiles = 0, misses = 0, hit = 0, full = 0;
    for (const FrameReport& r : reports) {
      ms.push_back(1000 * r.seconds);
      late += r.seconds > period;
      tiles += r.tiles, misses += r.misses;
      hit += r.pixels_hit, full += r.pixels_full;
      least_full = std::min(least_full, r.full_share());
      loads += r.loads, load_bytes += r.load_bytes;
      level_shares.resize(std::max(level_shares.size(), r.level_pixels.size()));
      for (std::size_t level = 0; level < r.level_pixels.size(); ++level)
        level_shares[level] += static_cast<double>(r.level_pixels[level]);
    }
    std::ranges::sort(ms);
    mean_ms = std::accumulate(ms.begin(), ms.end(), 0.0) / static_cast<double>(frames);
    p95_ms = ms[(frames - 1) * 95 / 100];
    worst_ms = ms.back();
    for (double& share : level_shares)
      share /= static_cast<double>(std::max<std::uint64_t>(hit, 1));
    mean_full = hit ? static_cast<double>(full) / static_cast<double>(hit) : 1;
    hit_rate = tiles ? 1 - static_cast<double>(misses) / static_cast<double>(tiles) : 1;
  }
};

/// The result of playing with one way of loading.
struct PlayResult {
  Loading loading = Loading::ahead;
  Summary summary{};
  std::vector<FrameReport> frames{};

  void describe(auto& member) const {
    member("loading", name(loading), "way of loading");
    member("summary", summary, "");
    member("frames", frames, "in order");
  }
};

struct Played {
  std::string field{};
  double fps = 0;
  PixelSize size{};
  std::uint64_t memory_bytes = 0;
  std::vector<PlayResult> runs{};

  void describe(auto& member) const {
    member("field", field, "path");
    member("fps", fps, "frames a second", R"("minimum": 0)");
    member("width_pixels", size.width, "of the pictures", R"("minimum": 1)");
    member("height_pixels", size.height, "of the pictures", R"("minimum": 1)");
    member("memory_bytes", memory_bytes, "budget");
    member("runs", runs, "one for each way of loading");
  }
};

/// Sleeps until then. False: a signal asked to stop.
bool wait_until(Clock::time_point due) {
  constexpr auto kNap = std::chrono::milliseconds(100);
  for (auto now = Clock::now(); now < due && stop_signal() == 0; now = Clock::now())
    std::this_thread::sleep_until(std::min(due, now + kNap));
  return stop_signal() == 0;
}

/// The players of the states that frames show in turn. Those of the next few are made ahead, each
/// with its share of the memory, and load the views that their frames will show.
class StatePlayers {
 public:
  /// `states`: none for the one that the field shows.
  StatePlayers(Field field, std::span<const unsigned> states, PlayOptions options,
               DrawArguments draw)
      : field_(std::move(field)),
        states_(states.begin(), states.end()),
        options_(std::move(options)),
        draw_(std::move(draw)) {
    options_.renderer.memory /= window();
    draw_.memory /= window();
  }

  /// The player of frame k. `camera(k)` is that of any frame.
  template <class CameraOf>
  Result<Player*> at(std::size_t k, const CameraOf& camera) {
    for (std::size_t next = k; next < k + window(); ++next) {
      Made& made = players_[slot(next)];
      if (!made.making.valid() && !made.player)
        made.making = std::async(std::launch::async, [this, next, at = camera(next)] {
          auto player = make(next);
          if (player) player->expect(at);
          return player;
        });
      else if (next > k && made.player)
        made.player->expect(camera(next));
    }
    std::erase_if(players_, [&](const auto& made) {
      for (std::size_t next = k; next < k + window(); ++next)
        if (slot(next) == made.first) return false;
      return true;
    });
    Made& made = players_[slot(k)];
    if (!made.player) {
      auto player = SLF_TRY(made.making.get());
      made.player.emplace(std::move(player));
    }
    return &*made.player;
  }

 private:
  struct Made {
    std::future<Result<Player>> making;
    std::optional<Player> player;
  };
  [[nodiscard]] std::size_t window() const {
    return std::clamp<std::size_t>(states_.size(), 1, kStatesAhead);
  }
  [[nodiscard]] std::size_t slot(std::size_t k) const {
    return states_.empty() ? 0 : k % states_.size();
  }
  [[nodiscard]] Result<Player> make(std::size_t k) const {
    if (states_.empty()) return Player::make(field_, options_);
    const auto shown = SLF_TRY(field_.in_state(states_[slot(k)]));
    PlayOptions options = options_;
    if (options.view.cap) options.view.cap = SLF_TRY(draw_.cap_of(shown, options.view.clip));
    return Player::make(shown, options);
  }

  static constexpr std::size_t kStatesAhead = 4;
  const Field field_;
  const std::vector<unsigned> states_;
  PlayOptions options_;
  DrawArguments draw_;
  std::map<std::size_t, Made> players_;
};

/// The states that frames show in turn; none for one.
Result<std::vector<unsigned>> states_to_play(const PlayArguments& a, const Field& field) {
  std::vector<unsigned> states;
  if (a.states.empty()) return states;
  const auto count = static_cast<unsigned>(std::max<std::size_t>(1, field.states().size()));
  const std::size_t colon = a.states.find(':');
  const std::string begin = a.states.substr(0, colon),
                    end = colon == std::string::npos ? "" : a.states.substr(colon + 1);
  unsigned first = 0, last = count;
  const bool numbers = (begin.empty() || CLI::detail::lexical_cast(begin, first)) &&
                       (end.empty() || CLI::detail::lexical_cast(end, last));
  if (colon == std::string::npos || !numbers || first >= last || last > count)
    return fail(ErrorCode::usage, "--states ", a.states, ": expected FIRST:END within 0:", count,
                ", as 0:", count, " or :");
  for (unsigned state = first; state < last; ++state) states.push_back(state);
  return states;
}

/// Plays the path in real time. While a picture is written the clock stops, but the loading thread
/// goes on.
Result<PlayResult> play(const PlayArguments& a, Loading way, FrameFiles* pictures) {
  if (a.cold && !is_address(a.field.path)) SLF_TRY(drop_page_cache(a.field.path));
  const auto field = SLF_TRY(a.draw.open(a.field));
  const auto path = SLF_TRY(a.camera_path(field.shape().sphere));
  const auto view = SLF_TRY(a.draw.view(field));
  const PlayOptions options{a.draw.renderer(view), view, way, a.horizon};
  const auto states = SLF_TRY(states_to_play(a, field));
  StatePlayers players(field, states, options, a.draw);

  PlayResult played{options.loading};
  ResidentMemory peak;
  const auto frames = static_cast<std::size_t>(std::max(1.0, std::round(path.seconds() * a.fps)));
  const auto progress = progress_bar(fmt::format("Playing, loading {}", name(options.loading)),
                                     "frames", OnSignal::stop);
  Image image;
  const auto camera_of = [&](std::size_t k) {
    return path.at(static_cast<double>(k) / a.fps, a.size.width, a.size.height);
  };
  SLF_TRY(players.at(0, camera_of));
  const auto period = std::chrono::duration<double>(1 / a.fps);
  auto due = Clock::now();
  for (std::size_t k = 0; k < frames && progress({k, frames, 0}); ++k) {
    if (!wait_until(due)) break;
    Player* const player = SLF_TRY(players.at(k, camera_of));
    SLF_TRY(player->draw(camera_of(k), image, &played.frames.emplace_back()));
    due += std::chrono::duration_cast<Clock::duration>(period);
    const ResidentMemory now = resident_memory();
    peak.anonymous = std::max(peak.anonymous, now.anonymous);
    peak.file = std::max(peak.file, now.file);
    if (!pictures || !pictures->enabled()) continue;
    const auto begin = Clock::now();
    SLF_TRY(map_tones(field, {}, /*display=*/true, image));
    SLF_TRY(pictures->add(k, image));
    due += Clock::now() - begin;
  }
  (void)progress({frames, frames, 0});
  if (!played.frames.empty()) played.summary = Summary(played.frames, 1 / a.fps);
  played.summary.peak = peak;
  return played;
}

/// The shares of all levels in percent, the finest first.
std::string shares_text(const std::vector<double>& shares) {
  std::vector<std::string> texts;
  for (auto share = shares.rbegin(); share != shares.rend(); ++share)
    texts.push_back(fmt::format("{:.0f}", 100 * *share));
  return fmt::format("{}", fmt::join(texts, " "));
}

std::string played_row(const PlayResult& played) {
  const Summary& s = played.summary;
  return fmt::format(
      "{}\t{}\t{}\t{:.1f}\t{:.1f}\t{:.1f}\t{:.2f} %\t{:.2f} %\t{}\t{:.2f} %\t{}\t{}\t{}\t{}",
      name(played.loading), s.frames, s.late, s.mean_ms, s.p95_ms, s.worst_ms, 100 * s.mean_full,
      100 * s.least_full, shares_text(s.level_shares), 100 * s.hit_rate, s.loads,
      human_bytes(s.load_bytes), human_bytes(s.peak.anonymous), human_bytes(s.peak.file));
}

Result<void> run_play(const PlayArguments& a) {
  if (!a.preview.empty() && !a.preview.ends_with(".webp"))
    return fail(ErrorCode::usage, "--preview ", a.preview, ": expected a name ending in .webp");
  auto pictures = SLF_TRY(FrameFiles::make(a));

  Played all{a.field.path, a.fps, a.size, a.draw.memory};
  std::vector<std::string> rows{
      "loading\tframes\tlate\tmean ms\t95 %\tworst\tfull level\tleast\t% by level\thits\tloads\t"
      "read\tanonymous\tmapped"};
  for (const Loading way : a.loading) {
    // Pictures are written for the first way of loading only.
    const auto played = SLF_TRY(play(a, way, all.runs.empty() ? &pictures : nullptr));
    if (played.frames.empty()) break;
    rows.push_back(played_row(played));
    all.runs.push_back(played);
    if (stop_signal() != 0) break;
  }
  if (stop_signal() == 0) SLF_TRY(pictures.close());  // a part of an animation replaces nothing
  if (a.json) {
    print_json(all);
    return {};
  }
  print("{} at {} frames a second, {} pixels; late: drawn in more than {:.1f} ms\n", a.field.path,
        a.fps, to_string(a.size), 1000 / a.fps);
  print_table(rows);
  return {};
}

}  // namespace

void add_play(CLI::App& app, Run& run) {
  const auto [command, a] = add_command(
      app, run, "play",
      "Fly around a field at a steady frame rate, loading tiles ahead of the camera", run_play);
  a->field.add_to(*command, "Field to play");
  command
      ->add_option("--states", a->states,
                   "Show these states of the field in turn, one in each frame: a half-open\n"
                   "range of their numbers, as 0:40; : are all")
      ->type_name("FIRST:END")
      ->excludes("--state");
  command->option_defaults()->group("Path");
  auto* keys =
      command->add_option("--path", a->path,
                          "Keyframes, JSON: {\"keys\": [{\"at\": 0, \"orbit\": [0,20,3]},\n"
                          "{\"at\": 4, \"eye\": [x,y,z], \"look_at\": [x,y,z], \"fov\": 30}]}");
  keys->type_name("FILE.json");
  add_orbit(*command, a->orbit, "Without --path: azimuth, elevation and distance to start from")
      ->excludes(keys);
  add_number(*command, "--turns", a->turns, "Number of turns of an orbit", from_to(-1e6, 1e6));
  add_number(*command, "--seconds", a->seconds, "Length of an orbit", above(0, 86400));
  add_number(*command, "--fps", a->fps, "Frames per second", from_to(0.01, 1000));
  add_size(*command, a->size);
  command->option_defaults()->group("Loading");
  choose(command->add_option(
             "--loading", a->loading,
             "ahead: a thread loads the tiles of predicted views; demand: only tiles that a\n"
             "frame lacked; wait: no thread, frames wait for their tiles. Several, separated\n"
             "by commas, are played in turn and compared"),
         Choices<Loading>{
             {"ahead", Loading::ahead}, {"demand", Loading::demand}, {"wait", Loading::wait}})
      ->delimiter(',')
      ->default_str("ahead");
  add_number(*command, "--horizon", a->horizon, "Frames to load ahead", from_to(0, 1000));
  command->add_flag("--cold", a->cold,
                    "Ask the kernel to forget the file before each run, so that\n"
                    "tiles come from the disk");
  a->draw.add_to(*command);
  command->option_defaults()->group("Output");
  add_file(*command, "--frames", a->frames, "Write every frame as PNG into this folder", kFolder);
  command->add_option("--preview", a->preview, "Write an animated WebP")->type_name("FILE.webp");
  command->add_flag("-f,--force", a->force, "Overwrite pictures");
  add_json<Played>(*command, a->json, "Summary and every frame as JSON");
}

}  // namespace slf::cli
