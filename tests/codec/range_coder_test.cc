#include "codec/range_coder.h"

#include <gtest/gtest.h>

#include <cstdint>
#include <random>
#include <vector>

#include "codec/predictive_tables.h"

namespace slf::codec {
namespace {

struct Decision {
  std::size_t model;  // 8: as likely as not
  bool value;
};

/// Decisions of models that are mostly 0, mostly 1, or neither.
std::vector<Decision> random_decisions(std::uint32_t seed, std::size_t count) {
  std::mt19937 random(seed);
  std::vector<Decision> decisions;
  for (std::size_t k = 0; k < count; ++k) {
    const std::size_t model = random() % 9;
    const std::uint32_t rarely = model < 3 ? 2 : model < 6 ? 500 : 998;
    decisions.push_back({model, random() % 1000 < rarely});
  }
  return decisions;
}

template <class Coder>
bool code(Coder& coder, std::vector<BitModel>& models, const Decision& decision) {
  return decision.model == 8 ? coder.even_bit(decision.value)
                             : coder.bit(models[decision.model], decision.value);
}

Bytes encoded(const std::vector<Decision>& decisions) {
  Bytes bytes;
  RangeEncoder encoder(bytes);
  std::vector<BitModel> models(8);
  for (const Decision& decision : decisions) code(encoder, models, decision);
  encoder.finish();
  return bytes;
}

TEST(RangeCoder, DecisionsComeBack) {
  for (std::uint32_t seed = 0; seed < 300; ++seed) {
    const auto decisions = random_decisions(seed, seed * seed % 5000);
    const Bytes bytes = encoded(decisions);
    RangeDecoder decoder(bytes);
    std::vector<BitModel> models(8);
    for (std::size_t k = 0; k < decisions.size(); ++k)
      ASSERT_EQ(code(decoder, models, {decisions[k].model, false}), decisions[k].value)
          << "seed " << seed << ", decision " << k;
    EXPECT_TRUE(decoder.finished()) << "seed " << seed;
  }
}

TEST(RangeCoder, TheExampleOfTheFormat) {
  Bytes bytes;
  RangeEncoder encoder(bytes);
  BitModel model(probability_of(128));
  for (const bool value : {true, true, false, true}) encoder.bit(model, value);
  encoder.finish();
  EXPECT_EQ(probability_of(128), 33024);
  EXPECT_EQ(bytes, Bytes{std::byte{0x25}});
}

TEST(RangeCoder, WhatIsLikelyCostsLittle) {
  Bytes bytes;
  RangeEncoder encoder(bytes);
  BitModel model;
  for (int k = 0; k < 100'000; ++k) encoder.bit(model, false);
  encoder.finish();
  EXPECT_LT(bytes.size(), 40u);  // 0.0015 bits each
}

TEST(RangeCoder, ACarryRunsThroughBytesThatWait) {
  // Decisions of value 0 raise `low`, so that long rows of 0xFF are carried over now and then.
  std::vector<Decision> decisions;
  for (int k = 0; k < 20'000; ++k) decisions.push_back({8, false});
  decisions.push_back({8, true});
  const Bytes bytes = encoded(decisions);
  RangeDecoder decoder(bytes);
  std::vector<BitModel> models(8);
  for (const Decision& decision : decisions)
    ASSERT_EQ(code(decoder, models, {decision.model, false}), decision.value);
}

TEST(RangeCoder, BytesTooManyOrTooFewAreNoticed) {
  const auto decisions = random_decisions(7, 3000);
  Bytes bytes = encoded(decisions);
  const auto finished = [&](ByteSpan from) {
    RangeDecoder decoder(from);
    std::vector<BitModel> models(8);
    for (const Decision& decision : decisions) code(decoder, models, {decision.model, false});
    return decoder.finished();
  };
  EXPECT_TRUE(finished(bytes));
  EXPECT_FALSE(finished(ByteSpan(bytes).first(bytes.size() / 2)));
  EXPECT_FALSE(finished({}));
  bytes.resize(bytes.size() + 9);
  EXPECT_FALSE(finished(bytes));
}

TEST(RangeCoder, ProbabilitiesNeverReachCertainty) {
  BitModel zero, one;
  for (int k = 0; k < 10'000; ++k) zero.learn(false), one.learn(true);
  EXPECT_GT(zero.probability(), 0u);
  EXPECT_LT(one.probability(), 32768u);
}

}  // namespace
}  // namespace slf::codec
