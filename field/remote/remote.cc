#include "slf/remote.h"

#include "field/field_file.h"
#include "field/remote/http_source.h"

namespace slf {

struct RemoteField::State {
  std::shared_ptr<HttpSource> source;
};

Result<RemoteField> RemoteField::open(const std::string& url, const RemoteOptions& options,
                                      const ProgressCallback& progress) {
  auto source = HttpSource::open(url, options, progress);
  if (!source) return tl::unexpected(std::move(source.error()));
  auto store = storage::TileStore::open(*source);
  if (!store) return tl::unexpected(std::move(store.error()));
  auto file = FieldFile::open(std::move(*store));
  if (!file) return tl::unexpected(std::move(file.error()));
  return RemoteField(std::make_shared<State>(State{*source}), Field::of(std::move(*file)));
}

RemoteTraffic RemoteField::traffic() const { return state_->source->traffic(); }

}  // namespace slf
