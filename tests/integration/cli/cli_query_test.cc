// SPDX-License-Identifier: Apache-2.0
//
// view, shade and segments: the same bytes by every strategy, cut, thread count and transport.
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>
#include <numbers>

#include "absl/strings/str_format.h"
#include "client/lib/client.h"
#include "client/lib/connection.h"
#include "tests/integration/cli/cli_testing.h"
#include "tests/support/random.h"
#include "tests/support/scenes.h"
#include "tests/support/test_scale.h"

namespace sightline::cli {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using testing_support::TestRng;

// Ways of asking that must not show in the answer.
std::vector<std::vector<std::string>> Ways(const std::string& server) {
  return {{"--strategy", "AUTO"},
          {"--strategy", "SINGLE", "--threads", "1"},
          {"--strategy", "PACKET", "--streams", "3"},
          {"--strategy", "SHAFT"},
          {"--strategy", "BRUTE_FORCE"},
          {"--strategy", "RTT"},
          {"--structure", "KD_TREE"},
          {"--strategy", "PACKET", "--structure", "KD_TREE"},
          {"--structure", "BINARY_BVH", "--strategy", "PACKET", "--packet-side", "8",
           "--leaf-culling", "side-planes,near-far,aperture,masked"},
          {"--structure", "BINARY_BVH", "--binary-bins", "4", "--binary-cost", "0.1"},
          {"--strategy", "RTT", "--kd-cost", "0.1", "--kd-perfect-splits", "--build", "dynamic"},
          {server, "--structure", "KD_TREE", "--kd-min-leaf", "8", "--kd-lay-out-leaves"},
          {server, "--strategy", "RTT", "--rtt-antialiasing", "2", "--rtt-shared-edges"},
          {server, "--strategy", "SINGLE", "--structure", "KD_TREE"},
          {server, "--strategy", "AUTO"},
          {server, "--strategy", "SINGLE", "--streams", "4"},
          {server, "--strategy", "PACKET"},
          {server, "--strategy", "SHAFT"},
          {server, "--strategy", "BRUTE_FORCE"}};
}

std::vector<std::string> Join(std::vector<std::string> a, const std::vector<std::string>& b) {
  a.insert(a.end(), b.begin(), b.end());
  return a;
}

TEST_F(CliTest, ViewGivesTheSameBytesEveryWay) {
  const std::unique_ptr<Server> server = StartServer();
  ASSERT_NE(server, nullptr);
  const std::string obj = Write("small.obj", kSmallObj);
  for (const std::string& scene : {obj, std::string("builtin:box:1000")}) {
    std::vector<std::string> first;
    int k = 0;
    for (std::vector<std::string> way : Ways(ServerFlag(*server))) {
      // Tiles that do not divide the picture, each time others.
      way.push_back(absl::StrCat("--tile=", 16 + 9 * k));
      const std::string base = File(absl::StrCat("v", k++));
      Good(Join({"view", scene, "--size", "101x67", "--out", "lit:" + base + "lit.png", "--out",
                 "depth:" + base + "depth.png", "--ids", base + "ids.npy", "--depth",
                 base + "depth.npy", "--lit", base + "lit.npy"},
                way));
      std::vector<std::string> bytes;
      for (const char* end : {"lit.png", "depth.png", "ids.npy", "depth.npy", "lit.npy"}) {
        bytes.push_back(Read(base + end));
      }
      if (first.empty()) first = bytes;
      EXPECT_TRUE(bytes == first) << scene << " by " << testing::PrintToString(way);
    }
  }
}

TEST_F(CliTest, ViewLooksIntoMirrorsTheSameEveryWay) {
  const std::vector<std::string> view = {"view", "builtin:box:1000", "--size", "64x48"};
  std::vector<std::string> first;
  for (const std::vector<std::string>& way :
       {std::vector<std::string>{"--strategy", "BRUTE_FORCE"}, {}, {"--strategy", "RTT"}}) {
    const std::string ids = File("ids.npy"), lit = File("lit.npy"), out = File("lit.png");
    const RunResult result =
        Good(Join(Join(view, {"--mirror", "wall-back", "--mirror", "ball=0,0,0,1,1,0", "--ids", ids,
                              "--lit", lit, "--out", out}),
                  way));
    EXPECT_THAT(result.out, HasSubstr("; in mirrors "));
    const std::vector<std::string> bytes = {Read(ids), Read(lit), Read(out)};
    if (first.empty()) first = bytes;
    EXPECT_TRUE(bytes == first) << testing::PrintToString(way);
  }
  const std::string ids = File("ids.npy");
  Good(Join(view, {"--ids", ids}));
  EXPECT_NE(Read(ids), first[0]);
  const std::string out = File("no.png");
  Bad(kExitUsage, Join(view, {"--out", out, "--mirror", "ball=1,2"}), {"--mirror", "six numbers"});
  const auto refused = [&](const char* mirror, const char* why) {
    const RunResult result = RunCommand(Join(view, {"--out", out, "--mirror", mirror}));
    EXPECT_NE(result.code, 0);
    EXPECT_THAT(result.err, HasSubstr(why));
  };
  refused("ball", "is not flat");
  refused("door", "no such object");
}

TEST_F(CliTest, ViewWritesWhatItSays) {
  const std::string obj = Write("small.obj", kSmallObj);
  Good({"view",    obj,
        "--eye",   "5,-20,8",
        "--at",    "5,5,1",
        "--up",    "0,0,1",
        "--fov",   "40",
        "--size",  "40x30",
        "--light", "2,5,9",
        "--light", "9,5,1",
        "--sun",   "0,0,1",
        "--ids",   File("ids.npy"),
        "--depth", File("depth.npy"),
        "--lit",   File("lit.npy"),
        "--out",   File("v.png")});
  const NpyArray ids = ReadNpy(File("ids.npy")).value();
  const NpyArray depth = ReadNpy(File("depth.npy")).value();
  const NpyArray lit = ReadNpy(File("lit.npy")).value();
  EXPECT_EQ(ids.dtype, "<i4");
  EXPECT_THAT(ids.shape, ElementsAre(30, 40, 2));
  EXPECT_EQ(depth.dtype, "<f4");
  EXPECT_THAT(depth.shape, ElementsAre(30, 40));
  EXPECT_EQ(lit.dtype, "|u1");
  EXPECT_THAT(lit.shape, ElementsAre(3, 30, 40));
  int hits = 0;
  for (size_t i = 0; i < 1200; ++i) {
    const bool hit = ids.values[2 * i] >= 0;
    hits += hit;
    EXPECT_EQ(hit, ids.values[2 * i + 1] >= 0);
    EXPECT_EQ(hit, std::isfinite(depth.values[i]));
    for (size_t k = 0; k < 3; ++k) EXPECT_EQ(hit, lit.values[k * 1200 + i] != 255);
  }
  EXPECT_GT(hits, 100);
  EXPECT_LT(hits, 1200);
  // The corners look past the scene.
  EXPECT_EQ(ids.values[0], -1);
  EXPECT_THAT(Read(File("v.png")), testing::StartsWith("\x89PNG"));
}

// Suns by time and patches of a sky are directions like any other.
TEST_F(CliTest, SunsByTimeAndSkies) {
  const std::string obj = Write("small.obj", kSmallObj);
  const std::string points = WriteDoubles("P.npy", {1, 1, 0.5, 7, 5, 1, 4.5, 8, 0.1}, 3);
  const std::string time = "2026-06-21T10:00Z,52.5,13.4";
  const nlohmann::json json = nlohmann::json::parse(
      Good({"shade", obj, "--points", points, "--up", "0,0,1", "--sun-at", time, "--sky", "145",
            "--out", File("sky.npy"), "--output", "json"})
          .out);
  EXPECT_EQ(json["lights"], 146);
  ASSERT_EQ(json["suns"].size(), 1u);
  EXPECT_EQ(json["suns"][0]["at"], time);
  EXPECT_NEAR(json["suns"][0]["altitude_deg"].get<double>(), 58.161, 0.0127);
  // The same lights as plain directions, by the angles that were said: z up, y north.
  const auto direction = [](double altitude, double azimuth) {
    const double a = altitude * std::numbers::pi / 180, z = azimuth * std::numbers::pi / 180;
    return absl::StrFormat("%.17g,%.17g,%.17g", std::cos(a) * std::sin(z),
                           std::cos(a) * std::cos(z), std::sin(a));
  };
  std::vector<std::string> args = {
      "shade",    obj,
      "--points", points,
      "--sun",    direction(json["suns"][0]["altitude_deg"], json["suns"][0]["azimuth_deg"]),
      "--out",    File("suns.npy")};
  const int patches[] = {30, 30, 24, 24, 18, 12, 6, 1};
  for (int row = 0; row < 8; ++row) {
    for (int i = 0; i < patches[row]; ++i) {
      args.insert(args.end(), {"--sun", direction(6 + 12 * row, 360.0 * i / patches[row])});
    }
  }
  Good(args);
  const NpyArray sky = ReadNpy(File("sky.npy")).value();
  const NpyArray suns = ReadNpy(File("suns.npy")).value();
  EXPECT_THAT(sky.shape, ElementsAre(146, 3));
  EXPECT_EQ(sky.values, suns.values);
  EXPECT_THAT(sky.values, testing::Contains(1));
  EXPECT_THAT(sky.values, testing::Contains(0));

  const RunResult view = Good({"view", obj, "--size", "32x24", "--sun-at", time, "--sky", "145",
                               "--out", File("v.png"), "--stats"});
  EXPECT_THAT(view.out, HasSubstr("sun at " + time));
  EXPECT_THAT(view.out, HasSubstr("over 146 lights"));
}

// A floor at z = 0 and a roof at z = 1, an object each.
TEST_F(CliTest, MasksSayWhichObjectsAreSeen) {
  const std::unique_ptr<Server> server = StartServer();
  ASSERT_NE(server, nullptr);
  const std::string flag = ServerFlag(*server);
  const std::vector<double> floor = {-9, -9, 0, 9, -9, 0, 0, 18, 0},
                            roof = {-9, -9, 1, 9, -9, 1, 0, 18, 1};
  const std::vector<uint32_t> indices = {0, 1, 2};
  const client::Client client(
      client::MakeConnection(absl::StrCat("127.0.0.1:", server->port()), {}));
  client::SceneSource source{.scene_id = "masked"};
  source.objects.push_back(
      {.name = "roof", .vertices = roof, .indices = indices, .mask = 0x80000000u});
  source.objects.push_back({.name = "floor", .vertices = floor, .indices = indices, .mask = 2});
  ASSERT_TRUE(client.CreateScene(source).ok());
  const std::string segments = WriteDoubles("S.npy", {0, 0, 2, 0, 0, 0.5, 0, 0, 0.5, 0, 0, -1}, 6);
  const std::string points = WriteDoubles("P.npy", {0, 0, 0.5, 0, 0, -1}, 3);
  const std::string lights = WriteDoubles("L.npy", {0, 0, 5}, 3);
  const struct {
    const char* mask;
    std::vector<double> hit, lit;  // Of the segments; of the points.
    double depth;                  // From z = 5, straight down.
    double color;                  // Of a light over the roof, there.
  } kMasks[] = {{"0xFFFFFFFF", {1, 1}, {0, 0}, 4, 1},
                {"0x80000000", {1, 0}, {0, 0}, 4, 1},
                {"2", {0, 1}, {1, 0}, 5, 1},
                {"5", {0, 0}, {1, 1}, std::numeric_limits<double>::infinity(), 0}};
  for (const auto& row : kMasks) {
    SCOPED_TRACE(row.mask);
    const auto ask = [&](std::vector<std::string> args, const char* out) {
      Good(Join(std::move(args), {flag, "--mask", row.mask}));
      return ReadNpy(File(out)).value().values;
    };
    EXPECT_EQ(
        ask({"segments", "scenes/masked", "--segments", segments, "--out", File("h.npy")}, "h.npy"),
        row.hit);
    EXPECT_EQ(ask({"shade", "scenes/masked", "--points", points, "--lights", lights, "--out",
                   File("l.npy")},
                  "l.npy"),
              row.lit);
    const std::vector<std::string> camera = {"scenes/masked", "--size", "3x3",  "--eye", "0,0,5",
                                             "--at",          "0,0,0",  "--up", "0,1,0"};
    EXPECT_EQ(ask(Join(Join({"view"}, camera), {"--depth", File("d.npy")}), "d.npy")[4], row.depth);
    EXPECT_EQ(ask(Join(Join({"relight"}, camera), {"--light", "0,0,4", "--by", "1,0,0", "--frames",
                                                   "2", "--color", File("c.npy")}),
                  "c.npy")[4],
              row.color);
  }
}

// However the server parts an item's pixels.
TEST_F(CliTest, TilesOfRelevantTrianglesAreWhole) {
  for (const int n : {1, 3, 5, 6}) {
    const nlohmann::json json = nlohmann::json::parse(
        Good({"view", "builtin:box:1000", "--size", "480x480", "--tile", "480", "--strategy", "RTT",
              "--rtt-antialiasing", absl::StrCat(n), "--light", "0,0,0", "--lit", File("lit.npy"),
              "--output", "json"})
            .out);
    // The eye's, and the light's: all pixels see the box.
    EXPECT_EQ(json["tiles"], 2 * (480 / (4 * n)) * (480 / (4 * n))) << json;
  }
}

// Likewise: where all pixels see something, nothing stands in but at the picture's edge.
TEST_F(CliTest, PixelShadowPacketsAreWhole) {
  constexpr int kLights = 40;
  std::vector<std::string> args = {"view",
                                   "builtin:box:1000",
                                   "--size",
                                   "480x480",
                                   "--tile",
                                   "480",
                                   "--lit",
                                   File("lit.npy"),
                                   "--output",
                                   "json",
                                   "--strategy",
                                   "PACKET",
                                   "--pixel-shadow-packets"};
  for (int i = 0; i < kLights; ++i) args.insert(args.end(), {"--light", "0,0,0"});
  const nlohmann::json json = nlohmann::json::parse(Good(args).out);
  EXPECT_EQ(json["hit_pixels"], 480 * 480);
  EXPECT_EQ(json["rays"], 480 * 480 * (1 + kLights));
}

TEST_F(CliTest, StrategyPictureTellsWhatAnswered) {
  const auto shares = [&](std::vector<std::string> more) {
    std::vector<std::string> args = {"view",     "builtin:box", "--size",
                                     "256x192",  "--out",       "strategy:" + File("s.png"),
                                     "--output", "json"};
    args.insert(args.end(), more.begin(), more.end());
    return nlohmann::json::parse(Good(args).out)["answered_by_shares"];
  };
  const nlohmann::json shaft = shares({"--strategy", "SHAFT"});
  EXPECT_GT(shaft["shaft"].get<double>(), 0.1);
  EXPECT_GT(shaft["triangles"].get<double>(), 0.05);
  EXPECT_NEAR(shaft["shaft"].get<double>() + shaft["triangles"].get<double>() +
                  shaft["packet"].get<double>() + shaft["ray"].get<double>(),
              1, 1e-9);
  EXPECT_EQ(shares({"--strategy", "SINGLE"})["ray"], 1.0);
  // Tiles by their lists of triangles, and the rays of those that have none.
  const nlohmann::json rtt = shares({"--strategy", "RTT"});
  EXPECT_GT(rtt["triangles"].get<double>(), 0.005);
  EXPECT_GT(rtt["packet"].get<double>(), 0.1);
  EXPECT_EQ(rtt["ray"], 0.0);
  EXPECT_EQ(shares({"--strategy", "PACKET"})["packet"], 1.0);
  // As figure 5 of paper 002 tells them apart: tiles without a relevant triangle, which see nothing
  // or are lit, tiles with some, and those that needed rays.
  for (const std::vector<std::string>& of :
       {std::vector<std::string>{}, {"--light", "2,8,4", "--strategy-of", "0"}}) {
    std::vector<std::string> args = {"view",       Write("small.obj", kSmallObj),
                                     "--up",       "0,0,1",
                                     "--size",     "256x192",
                                     "--strategy", "RTT",
                                     "--picture",  "strategy",
                                     "--out",      File("o.png"),
                                     "--output",   "json"};
    args.insert(args.end(), of.begin(), of.end());
    const nlohmann::json open = nlohmann::json::parse(Good(args).out)["answered_by_shares"];
    for (const char* kind : {"shaft", "triangles", "packet"}) {
      EXPECT_GT(open[kind].get<double>(), 0.02) << kind << " of " << open;
    }
    EXPECT_EQ(open["ray"], 0.0);
    EXPECT_NEAR(open["shaft"].get<double>() + open["triangles"].get<double>() +
                    open["packet"].get<double>(),
                1, 1e-9);
  }
  // Of the shadows of a light, and of a sun.
  EXPECT_EQ(shares({"--strategy", "PACKET", "--light", "0,0,1", "--sun", "1,2,3", "--strategy-of",
                    "1"})["packet"],
            1.0);
  EXPECT_EQ(shares({"--strategy", "PACKET", "--light", "0,0,1", "--sun", "1,2,3", "--strategy-of",
                    "0"})["packet"],
            1.0);
  EXPECT_THAT(Good({"view", "builtin:box", "--size", "64x48", "--picture", "strategy", "--out",
                    File("t.png")})
                  .out,
              HasSubstr("answered by shafts "));
  EXPECT_THAT(Read(File("t.png")), testing::StartsWith("\x89PNG"));
  Bad(kExitUsage,
      {"view", "builtin:box", "--size", "64x48", "--sun", "1,2,3", "--strategy-of", "1", "--out",
       "strategy:" + File("t.png")},
      {"--strategy-of names light 1, but there is 1, numbered from 0"});
  Bad(kExitUsage, {"view", "builtin:box", "--strategy-of", "sun", "--out", File("t.png")},
      {"eye, or the number of a light"});
}

TEST_F(CliTest, StatisticsAsTableAndAsJson) {
  const RunResult text = Good(
      {"view", "builtin:box", "--size", "64x48", "--out", "cost:" + File("cost.png"), "--stats"});
  for (const char* row : {"triangles", "build time", "tiles", "rays ", "rays/s in the engine",
                          "rays/s seen by the client", "bytes received"}) {
    EXPECT_THAT(text.out, HasSubstr(row));
  }
  const RunResult result =
      Good({"view", "builtin:box", "--size", "64x48", "--tile", "16", "--output", "json"});
  const nlohmann::json json = nlohmann::json::parse(result.out);
  EXPECT_EQ(json["tiles"], 12);
  EXPECT_EQ(json["pixels"], 64 * 48);
  EXPECT_EQ(json["lights"].size(), 3u);
  EXPECT_EQ(json["rays_asked"], 4 * 64 * 48);
  // Rays traced: every pixel's, and one per light for each that hits.
  EXPECT_EQ(json["rays"], 64 * 48 + 3 * json["hit_pixels"].get<int>());
  EXPECT_GT(json["rays_per_s_engine"], 0);
  EXPECT_GT(json["rays_per_s_client"], 0);
  EXPECT_GT(json["bytes_received"], 0);
  EXPECT_EQ(result.err, "");  // No progress where there is no terminal.
}

// Whole squares of pixels, of which some hit nothing: more rays, and the same lights.
TEST_F(CliTest, PixelShadowPacketsAskForMoreAndAnswerTheSame) {
  const std::string obj = Write("small.obj", kSmallObj);
  const auto view = [&](const std::vector<std::string>& more) {
    std::vector<std::string> args = {"view",     obj,     "--size",     "64x48",
                                     "--up",     "0,0,1", "--light",    "5,5,9",
                                     "--output", "json",  "--strategy", "PACKET"};
    args.insert(args.end(), more.begin(), more.end());
    return nlohmann::json::parse(Good(args).out);
  };
  const nlohmann::json hits = view({}), squares = view({"--pixel-shadow-packets"});
  ASSERT_LT(hits["hit_pixels"], 64 * 48);
  EXPECT_EQ(hits["rays"], 64 * 48 + hits["hit_pixels"].get<int>());
  EXPECT_GT(squares["rays"], hits["rays"]);
  EXPECT_EQ(squares["lights"], hits["lights"]);
}

TEST_F(CliTest, ShadeGivesTheSameBytesEveryWay) {
  const std::unique_ptr<Server> server = StartServer();
  ASSERT_NE(server, nullptr);
  const std::string obj = Write("small.obj", kSmallObj);
  TestRng rng;
  std::vector<double> points, lights;
  for (int i = 0; i < 3000; ++i) points.push_back(rng.Uniform(-1, 11));
  points[30] = std::numeric_limits<double>::quiet_NaN();
  points[301] = std::numeric_limits<double>::infinity();
  for (int i = 0; i < 15; ++i) lights.push_back(rng.Uniform(0, 10));
  const std::string p = WriteDoubles("P.npy", points, 3), l = WriteDoubles("L.npy", lights, 3);
  std::string first;
  int k = 0;
  for (const auto& way : Ways(ServerFlag(*server))) {
    const std::string out = File(absl::StrCat("lit", k++, ".npy"));
    const RunResult result = Good(Join(
        {"shade", obj, "--points", p, "--lights", l, "--sun", "0.1,0.2,1", "--out", out}, way));
    EXPECT_THAT(result.out, HasSubstr("invalid points  2"));
    if (first.empty()) first = Read(out);
    EXPECT_TRUE(Read(out) == first) << testing::PrintToString(way);
  }
  const NpyArray lit = ReadNpy(File("lit0.npy")).value();
  ASSERT_THAT(lit.shape, ElementsAre(6, 1000));
  for (size_t light = 0; light < 6; ++light) {
    for (size_t i = 0; i < 1000; ++i) {
      const bool invalid = i == 10 || i == 100;
      EXPECT_EQ(lit.values[light * 1000 + i] == 255, invalid) << light << " " << i;
    }
  }
}

TEST_F(CliTest, ShadeTellsLightFromShadow) {
  const std::string obj = Write("small.obj", kSmallObj);
  // Under the roof, beside it, and a point on the floor that --attach puts there.
  const std::string p = Write("P.csv", "x,y,z\n7,5,1\n2,5,1\n1,9,0\n");
  const std::string l = Write("L.csv", "7,5,9\nnan,0,0\n");
  Good({"shade", obj, "--points", p, "--lights", l, "--attach", "0.01", "--out", File("lit.npy")});
  EXPECT_THAT(ReadNpy(File("lit.npy")).value().values, ElementsAre(0, 1, 1, 255, 255, 255));
}

TEST_F(CliTest, SegmentsGiveTheSameBytesEveryWay) {
  const std::unique_ptr<Server> server = StartServer();
  ASSERT_NE(server, nullptr);
  const std::string obj = Write("small.obj", kSmallObj);
  TestRng rng;
  std::vector<double> segments;
  segments.reserve(6 * 2000);
  for (int i = 0; i < 6 * 2000; ++i) segments.push_back(rng.Uniform(-1, 11));
  segments[6 * 7 + 2] = std::numeric_limits<double>::quiet_NaN();
  const std::string s = WriteDoubles("S.npy", segments, 6);
  std::string first;
  int k = 0;
  for (const auto& way : Ways(ServerFlag(*server))) {
    const std::string out = File(absl::StrCat("hit", k++, ".npy"));
    Good(Join({"segments", obj, "--segments", s, "--out", out}, way));
    if (first.empty()) first = Read(out);
    EXPECT_TRUE(Read(out) == first) << testing::PrintToString(way);
  }
  const NpyArray hit = ReadNpy(File("hit0.npy")).value();
  ASSERT_THAT(hit.shape, ElementsAre(2000));
  EXPECT_EQ(hit.values[7], 255);
  EXPECT_GT(std::count(hit.values.begin(), hit.values.end(), 1.0), 200);
  EXPECT_GT(std::count(hit.values.begin(), hit.values.end(), 0.0), 200);
}

TEST_F(CliTest, NoRowsGiveNoResults) {
  const std::string obj = Write("small.obj", kSmallObj);
  Good({"segments", obj, "--segments", WriteDoubles("S.npy", {}, 6), "--out", File("hit.npy")});
  EXPECT_THAT(ReadNpy(File("hit.npy")).value().shape, ElementsAre(0));
}

TEST_F(CliTest, RealFilesTwiceGiveTheSameBytes) {
  // The thread sanitizer examines, and then suppresses, every eighth byte of a large message that
  // gRPC wrote: an upload of a megabyte takes it half an hour.
  SIGHTLINE_SCENE_OR_SKIP(
      path, testing_support::kThreadSanitizerBuild ? "cornell_box.obj" : "city_delft.obj.xz");
  std::string first;
  for (int i = 0; i < 2; ++i) {
    Good({"view", path, "--size", "160x90", "--ids", File("ids.npy"), "--lit", File("lit.npy"),
          "--out", File("v.png")});
    const std::string all = Read(File("ids.npy")) + Read(File("lit.npy")) + Read(File("v.png"));
    if (i == 0) first = all;
    EXPECT_TRUE(all == first);
  }
}

TEST_F(CliTest, RelightMovesALightAndComparesFrames) {
  const std::string obj = Write("small.obj", kSmallObj);
  const nlohmann::json json = nlohmann::json::parse(Good({"relight",   obj,
                                                          "--size",    "37x29",
                                                          "--up",      "0,0,1",
                                                          "--light",   "1,2,9",
                                                          "--light",   "3,1,8",
                                                          "--move",    "0",
                                                          "--by",      "4,0,-1",
                                                          "--frames",  "4",
                                                          "--compare", "4",
                                                          "--out",     File("moved.png"),
                                                          "--color",   File("color.npy"),
                                                          "--base",    File("base.npy"),
                                                          "--output",  "json"})
                                                        .out);
  EXPECT_EQ(json["frames"], 4);
  EXPECT_EQ(json["compared_frames"], 4);
  EXPECT_EQ(json["differing_answers"], 0);
  EXPECT_EQ(json["moving_light"], 0);
  // The last frame is the picture with the light there, and the base the one without it.
  const auto lit = [&](const std::vector<std::string>& lights) {
    std::vector<std::string> args = {"view",  obj,     "--size",        "37x29", "--up",
                                     "0,0,1", "--lit", File("lit.npy"), "--out", File("view.png")};
    args.insert(args.end(), lights.begin(), lights.end());
    Good(args);
    return Read(File("view.png"));
  };
  EXPECT_TRUE(lit({"--light", "5,2,8", "--light", "3,1,8"}) == Read(File("moved.png")));
  EXPECT_NE(Read(File("color.npy")), Read(File("base.npy")));
  Good({"relight", obj, "--size", "37x29", "--up", "0,0,1", "--light", "3,1,8", "--by", "0,0,0",
        "--frames", "1", "--color", File("alone.npy")});
  EXPECT_TRUE(Read(File("alone.npy")) == Read(File("base.npy")));
  Bad(kExitUsage, {"relight", obj}, {"--by"});
  Bad(kExitUsage, {"relight", obj, "--by", "1,0,0", "--light", "1,2,9", "--move", "1"},
      {"--move names light 1"});
  // For all frames together, each of which takes no time.
  Bad(kExitTemporary,
      {"relight", obj, "--by", "1,0,0", "--light", "1,2,9", "--compare", "0", "--frames", "100000",
       "--timeout", "1"},
      {"eadline"});
}

// By a published test answers may depend on which rays walk together: the kept hits walk row by
// row, the picture's by squares.
TEST_F(CliTest, RelightToleratesWhatAPublishedTestLeavesOpen) {
  for (const char* test : {"wald", "havel-herout", "moeller-trumbore"}) {
    const nlohmann::json json = nlohmann::json::parse(
        Good({"relight", "builtin:room:15000", "--size", "160x120", "--by", "0.4,0.3,0.1",
              "--frames", "4", "--compare", "4", "--strategy", "PACKET", "--intersector", test,
              "--leaf-culling", "aperture,skip-edges", "--output", "json"})
            .out);
    EXPECT_EQ(json["compared_frames"], 4) << json;
    EXPECT_LT(json["differing_answers"], 160 * 120) << json;
  }
}

// Lengths whose squares are no doubles, or zero; none changes a bit of what is seen.
TEST_F(CliTest, UpMayHaveAnyLength) {
  const std::string obj = Write("small.obj", kSmallObj);
  const std::string points = WriteDoubles("points.npy", {1, 1, 1, 8, 1, 1, 6, 5, 2}, 3);
  const auto seen = [&](const std::string& scene, const std::string& up) {
    Good({"view", scene, "--size", "37x29", "--auto-lights", "2", "--ids", File("ids.npy"),
          "--depth", File("depth.npy"), "--lit", File("view.npy"), "--up", up});
    Good(
        {"shade", scene, "--points", points, "--sky", "145", "--out", File("lit.npy"), "--up", up});
    std::string all;
    for (const char* file : {"ids.npy", "depth.npy", "view.npy", "lit.npy"})
      all += Read(File(file));
    return all;
  };
  for (const std::string& scene : {obj, std::string("builtin:box")}) {
    const std::string unit = seen(scene, "0,0,1");
    EXPECT_TRUE(seen(scene, "0,0,1e-200") == unit) << scene;
    EXPECT_TRUE(seen(scene, "0,0,1e200") == unit) << scene;
    EXPECT_TRUE(seen(scene, "0.25,0.5,0.75") == seen(scene, "1,2,3")) << scene;
  }
}

}  // namespace
}  // namespace sightline::cli
