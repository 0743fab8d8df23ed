#include "slf/tile_reader.h"

#include "base/guarded.h"
#include "base/try.h"
#include "field/tiles/tile_cache.h"

namespace slf {

struct TileReader::State {
  Field field;
  TileCache cache;

  State(const Field& of, const TileReaderOptions& options)
      : field(of), cache(field.file(), options.memory, field.state(), field.structures()) {}
};

TileReader::TileReader(const Field& field, const TileReaderOptions& options)
    : state_(new State(field, options), [](State* state) {
        if (!state->cache.lost()) delete state;
      }) {}

const Field& TileReader::field() const { return state_->field; }
TileCache& TileReader::cache() const { return state_->cache; }

Result<TileReader::Tile> TileReader::read(TileKey key) const {
  const FieldFile& file = field().file();
  if (!field().shape().has(key)) return misuse(file.path(), "has no tile ", storage::name(key));

  struct Held {
    std::shared_ptr<State> state;  // outlives the pin
    TileCache::Pin pin;
  };
  const AtWork at_work;
  return guarded([&]() -> Result<Tile> {
    auto pin = SLF_TRY(cache().load(in_state(key, field().state())));
    auto held = std::make_shared<Held>(Held{state_, std::move(pin)});
    Tile tile;
    tile.missing_ = held->pin.state() == storage::TileState::missing;
    if (const ByteSpan samples = held->pin.samples(); !samples.empty()) {
      const std::size_t colors = file.tile_shape(key).color_bytes();
      tile.colors_ = samples.first(colors);
      tile.depths_ = samples.subspan(colors);
    }
    tile.pin_ = std::move(held);
    return tile;
  });
}

}  // namespace slf
