// Views and notes: what is accepted, and what messages say.

#include "page/views.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace slf::page {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;

const Sphere kSphere{{10, 0, 0}, 2};

std::string error_of(const std::string& text) {
  const auto views = parse_views({"v.json", text}, kSphere);
  return views ? "" : views.error().message;
}

TEST(Views, AreCheckedAndSafeInAPage) {
  const auto views = parse_views(
      {"v.json", R"({"views": [{"title": "</script>", "orbit": [30, -20, 3], "target": [12, 0, 1]}],
                     "notes": [{"label": "a", "text": "b", "point": [1, 2, 3]}]})"},
      kSphere);
  ASSERT_TRUE(views) << views.error().message;
  EXPECT_THAT(views->json, Not(HasSubstr("<")));
  EXPECT_THAT(views->json, HasSubstr("/script>"));
  EXPECT_EQ(views->camera, (std::vector<double>{30, -20, 3, 1, 0, 0.5}));
  EXPECT_EQ(views->attributes, " view=\"30.0,-20.0,3.0,1.0,0.0,0.5\"");
  EXPECT_EQ(parse_views({}, kSphere)->json, "");
}

TEST(Views, StructuresOfTheFirstOneAreAnAttribute) {
  const auto views = parse_views({"v.json", R"({"views": [{"title": "a", "orbit": [0, 0, 3],
                                "structures": ["left, \"50%\":0.3", "stem"]}]})"},
                                 kSphere);
  ASSERT_TRUE(views) << views.error().message;
  EXPECT_EQ(views->attributes,
            " view=\"0.0,0.0,3.0\" structures=\"left%2C &quot;50%25&quot;:0.3,stem\"");
  EXPECT_THAT(error_of(R"({"views": [{"title": "a", "orbit": [0, 0, 3], "structures": "a"}]})"),
              HasSubstr("views[0].structures: expected a list of texts"));
}

TEST(Views, SayWhatAPageIsAbout) {
  const auto views = parse_views(
      {"v.json", R"({"about": {"title": "A", "source": "https://example.org"}})"}, kSphere);
  ASSERT_TRUE(views) << views.error().message;
  EXPECT_EQ(views->about.title, "A");
  EXPECT_EQ(views->about.source, "https://example.org");
  EXPECT_EQ(views->json, "");
  EXPECT_THAT(error_of(R"({"about": {}})"), HasSubstr("about.title: expected a text"));
  for (const char* source : {"javascript:alert(1)", "//host", "https://a b"})
    EXPECT_THAT(error_of(R"({"about": {"title": "A", "source": ")" + std::string(source) + "\"}}"),
                HasSubstr("about.source: expected an address"));
}

TEST(Views, ErrorsNameThePlaceAndWhatIsExpected) {
  EXPECT_THAT(error_of("{\n\"views\": [,]}"), HasSubstr("v.json, line 2: "));
  EXPECT_THAT(error_of("[]"), HasSubstr("v.json: expected an object"));
  EXPECT_THAT(error_of(R"({"view": []})"), HasSubstr("no member \"view\" is known"));
  EXPECT_THAT(error_of(R"({"views": [], "extra": 1})"), HasSubstr("\"extra\""));
  EXPECT_THAT(error_of(R"({"views": {}})"), HasSubstr("views: expected a list"));
  EXPECT_THAT(error_of(R"({"views": [1]})"), HasSubstr("views[0]: expected an object"));
  EXPECT_THAT(error_of(R"({"views": [{"title": "", "orbit": [0, 0, 3]}]})"),
              HasSubstr("views[0].title: expected a text"));
  EXPECT_THAT(error_of(R"({"views": [{"title": "a", "orbit": [0, 91, 3]}]})"),
              HasSubstr("views[0].orbit: expected [azimuth"));
  EXPECT_THAT(error_of(R"({"views": [{"title": "a"}]})"), HasSubstr("views[0].orbit"));
  const auto at = [](const std::string& distance) {  // distances are those of --orbit
    return error_of(R"({"views": [{"title": "a", "orbit": [0, 0, )" + distance + "]}]}");
  };
  for (const char* distance : {"0", "-1", "1.1e6"})
    EXPECT_THAT(at(distance), HasSubstr("above 0, at most 1e6"));
  for (const char* distance : {"0.01", "1e6"}) EXPECT_EQ(at(distance), "");
  EXPECT_THAT(error_of(R"({"notes": [{"label": "a", "point": [1, 2, null]}]})"),
              HasSubstr("notes[0].point: expected three numbers"));
}

}  // namespace
}  // namespace slf::page
