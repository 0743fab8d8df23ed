#include "codec/rans.h"

#include <gtest/gtest.h>

#include <array>
#include <random>
#include <span>

#include "codec/predictive_training.h"

namespace slf::codec {
namespace {

constexpr std::size_t kEven = 4;  // in place of a model

/// Of 2, 3, 17 and 81 symbols, from nearly even to nearly certain.
std::vector<SymbolModel> some_models() {
  std::vector<SymbolModel> models;
  for (const std::size_t symbols : {2, 3, 17, 81}) {
    std::vector<std::uint8_t> weights(symbols);
    for (std::size_t k = 0; k < symbols; ++k)
      weights[k] = static_cast<std::uint8_t>(k * 7 % 11 * (symbols % 4));
    weights[symbols / 2] = static_cast<std::uint8_t>(std::min<std::size_t>(63, symbols * 3));
    models.emplace_back(weights);
  }
  return models;
}

struct Symbol {
  std::size_t model;
  int bits;
  std::uint32_t value;
};

std::vector<Symbol> random_symbols(std::uint32_t seed, std::size_t count) {
  constexpr std::uint32_t kSymbols[] = {2, 3, 17, 81};
  std::mt19937 random(seed);
  std::vector<Symbol> symbols;
  for (std::size_t k = 0; k < count; ++k) {
    const std::size_t model = random() % 5;
    const int bits = static_cast<int>(1 + random() % 13);
    symbols.push_back(
        {model, bits,
         static_cast<std::uint32_t>(random()) % (model == kEven ? 1u << bits : kSymbols[model])});
  }
  return symbols;
}

Bytes encoded(const std::vector<Symbol>& symbols, std::span<const SymbolModel> models) {
  SymbolList list;
  for (const Symbol& symbol : symbols)
    symbol.model == kEven ? list.bits(symbol.bits, symbol.value)
                          : list.symbol(symbol.model, symbol.value);
  Bytes bytes;
  RansEncoder encoder(bytes);
  encoder.list(list, models);
  encoder.finish();
  EXPECT_LT(8 * static_cast<double>(bytes.size()), 1.002 * list.cost(models) + 33);
  return bytes;
}

std::uint32_t decoded(RansDecoder& decoder, const Symbol& symbol,
                      std::span<const SymbolModel> models) {
  return symbol.model == kEven ? decoder.bits(symbol.bits) : decoder.symbol(models[symbol.model]);
}

TEST(SymbolModel, FrequenciesAddUpAndNoneIsZero) {
  for (std::size_t symbols = 1; symbols <= SymbolModel::kMaxSymbols; ++symbols)
    for (const int high : {0, 5, 63})
      for (const std::size_t highs : {std::size_t{1}, symbols / 2, symbols}) {
        std::vector<std::uint8_t> weights(symbols);
        std::fill_n(weights.begin(), highs, static_cast<std::uint8_t>(high));
        const SymbolModel model(weights);
        std::uint32_t slot = 0;
        for (std::uint32_t k = 0; k < symbols; ++k) {
          ASSERT_EQ(model.start(k), slot);
          ASSERT_GT(model.frequency(k), 0u);
          ASSERT_LE(model.frequency(k), 4096u);
          for (const std::uint32_t at : {slot, slot + model.frequency(k) - 1})
            ASSERT_EQ(model.symbol_at(at), k);
          slot += model.frequency(k);
        }
        ASSERT_EQ(slot, 4096u);
      }
}

TEST(SymbolModel, StoredWeightsAreNearTheCounts) {
  const std::vector<double> counts{1, 10, 100, 1000, 400};
  std::vector<std::uint8_t> weights(counts.size());
  store_weights(counts, weights);
  const SymbolModel model(weights);
  for (std::uint32_t k = 0; k < counts.size(); ++k)
    EXPECT_NEAR(model.frequency(k), 4096 * counts[k] / 1511, 2 + 4096 * counts[k] / 1511 / 8) << k;
}

TEST(Rans, SymbolsComeBack) {
  const auto models = some_models();
  for (std::uint32_t seed = 0; seed < 300; ++seed) {
    const auto symbols = random_symbols(seed, seed * seed % 5000);
    const Bytes bytes = encoded(symbols, models);
    RansDecoder decoder(bytes);
    for (std::size_t k = 0; k < symbols.size(); ++k)
      ASSERT_EQ(decoded(decoder, symbols[k], models), symbols[k].value)
          << "seed " << seed << ", symbol " << k;
    EXPECT_TRUE(decoder.finished()) << "seed " << seed;
  }
}

TEST(Rans, TheExampleOfTheFormatHasTheseBytes) {
  const SymbolModel model(std::array<std::uint8_t, 3>{12, 8, 0});
  EXPECT_EQ(model.frequency(0), 2521u);
  EXPECT_EQ(model.frequency(1), 1260u);
  EXPECT_EQ(model.frequency(2), 315u);
  SymbolList list;
  for (const std::uint32_t value : {0u, 2u, 1u}) list.symbol(0, value);
  list.bits(3, 5);
  for (const std::uint32_t value : {2u, 2u, 0u}) list.symbol(0, value);
  Bytes bytes;
  RansEncoder encoder(bytes);
  encoder.list(list, std::span(&model, 1));
  encoder.finish();
  const auto byte = [](int value) { return static_cast<std::byte>(value); };
  EXPECT_EQ(bytes, (Bytes{byte(0x02), byte(0xe8), byte(0x52), byte(0xca), byte(0xfd)}));
}

TEST(Rans, DecisionsOfFixedModelsComeBack) {
  Bytes bytes;
  RansEncoder encoder(bytes);
  const BitModel models[] = {BitModel(1), BitModel(0x8000), BitModel(0xFFFF)};
  std::mt19937 random(3);
  std::vector<bool> values;
  for (int k = 0; k < 600; ++k) {
    values.push_back(random() % 2 != 0);
    encoder.bit(models[k % 3], values.back());
  }
  encoder.finish();
  RansDecoder decoder(bytes);
  for (int k = 0; k < 600; ++k) ASSERT_EQ(decoder.bit(models[k % 3]), values[k]) << k;
  EXPECT_TRUE(decoder.finished());
}

TEST(Rans, BytesTooManyTooFewOrOthersAreNoticed) {
  const auto models = some_models();
  const auto symbols = random_symbols(7, 3000);
  Bytes bytes = encoded(symbols, models);
  const auto finished = [&](ByteSpan from) {
    RansDecoder decoder(from);
    for (const Symbol& symbol : symbols) (void)decoded(decoder, symbol, models);
    return decoder.finished();
  };
  EXPECT_TRUE(finished(bytes));
  for (const std::size_t size :
       {std::size_t{0}, std::size_t{1}, bytes.size() / 2, bytes.size() - 1})
    EXPECT_FALSE(finished(ByteSpan(bytes).first(size))) << size;
  Bytes other = bytes;
  other[bytes.size() / 2] ^= std::byte{1};
  EXPECT_FALSE(finished(other));
  bytes.resize(bytes.size() + 2);
  EXPECT_FALSE(finished(bytes));
}

}  // namespace
}  // namespace slf::codec
