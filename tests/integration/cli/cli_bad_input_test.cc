// SPDX-License-Identifier: Apache-2.0
//
// What concerns files and flags in the table of bad input: one line, naming what is wrong, and its
// own exit code.
#include <sys/stat.h>

#include <filesystem>

#include "tests/integration/cli/cli_testing.h"
#include "tests/support/test_certificates.h"

namespace sightline::cli {
namespace {

TEST_F(CliTest, FilesThatAreNoScene) {
  const std::string out = File("v.png");
  Bad(kExitNoInput, {"view", File("none.obj"), "--out", out}, {"none.obj"});
  Bad(kExitNoInput, {"check", File("none.obj")}, {"none.obj"});
  Bad(kExitData, {"view", Write("empty.obj", ""), "--out", out}, {"empty.obj"});
  Bad(kExitData, {"view", Write("empty.stl", "solid x\nendsolid x\n"), "--out", out},
      {"empty.stl"});
  Bad(kExitData, {"check", Write("points.obj", "v 0 0 0\nv 1 0 0\n")}, {"points.obj"});
  Bad(kExitData, {"view", Write("what.xyzzy", "hello"), "--out", out}, {"what.xyzzy"});
  Bad(kExitData, {"view", dir_.path(), "--out", out}, {dir_.path()});
  Bad(kExitData, {"view", Write("flat.obj", "v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n"), "--out", out},
      {"flat.obj"});
  EXPECT_FALSE(ReadFile(out).ok());
}

TEST_F(CliTest, CommandLinesThatMakeNoSense) {
  const std::string obj = Write("small.obj", kSmallObj), out = File("v.png");
  Bad(kExitUsage, {}, {"sightline help"});
  Bad(kExitUsage, {"vieuw"}, {"did you mean view"});
  Bad(kExitUsage, {"scene"}, {"repository, list, show or delete"});
  Bad(kExitUsage, {"scene", "lod"}, {"did you mean scene load"});
  Bad(kExitUsage, {"view", "--out", out}, {"SCENE"});
  Bad(kExitUsage, {"view", obj, obj, "--out", out}, {"unexpected"});
  Bad(kExitUsage, {"view", obj}, {"nothing to do"});
  Bad(kExitUsage, {"view", obj, "--out", out, "--siez", "1x1"}, {"did you mean --size"});
  Bad(kExitUsage, {"view", obj, "--out", File("v.jpg")}, {".png"});
  for (const char* size : {"0x10", "10x0", "10", "ax10", "99999999x2", "-1x4", "65536x65536"}) {
    Bad(kExitUsage, {"view", obj, "--out", out, "--size", size}, {"--size", size});
  }
  for (const char* fov : {"0", "180", "-5", "nan", "wide"}) {
    Bad(kExitUsage, {"view", obj, "--out", out, "--fov", fov}, {"--fov", fov});
  }
  Bad(kExitUsage, {"view", obj, "--out", out, "--eye", "1,2,3", "--at", "1,2,3"}, {"eye"});
  Bad(kExitUsage, {"view", obj, "--out", out, "--eye", "1,2,inf"}, {"--eye"});
  Bad(kExitUsage, {"view", obj, "--out", out, "--eye", "0,0,5", "--at", "0,0,0", "--up", "0,0,1"},
      {"up"});
  Bad(kExitUsage, {"view", obj, "--out", out, "--strategy", "FAST"},
      {"AUTO, SINGLE, PACKET, SHAFT, RTT, BRUTE_FORCE"});
  Bad(kExitUsage, {"view", obj, "--out", out, "--structure", "GRID"}, {"AUTO, BVH, KD_TREE"});
  Bad(kExitUsage, {"view", obj, "--out", out, "--rtt-antialiasing", "7"}, {"--rtt-antialiasing"});
  for (const char* mask : {"-1", "4294967296", "0x", "0x100000000", "all", ""}) {
    Bad(kExitUsage, {"view", obj, "--out", out, "--mask", mask}, {"--mask"});
  }
  Bad(kExitUsage, {"view", obj, "--out", out, "--tile", "0"}, {"--tile"});
  Bad(kExitUsage, {"view", "builtin:nosuch", "--out", out}, {"nosuch"});
  Bad(kExitUsage, {"view", "scenes/x", "--out", out}, {"--server"});
  Bad(kExitUsage, {"scene", "list"}, {"--server"});
  Bad(kExitUsage, {"scene", "list", "--server", "nonsense"}, {"HOST:PORT"});
  Bad(kExitUsage, {"scene", "load", "scenes/x", "--name=y", "--server", "127.0.0.1:1"},
      {"scenes/x"});
  Bad(kExitUsage, {"shade", obj}, {"--points"});
  Bad(kExitUsage, {"shade", obj, "--points", "P.npy", "--out", out}, {"--lights"});
  Bad(kExitUsage,
      {"shade", obj, "--points", "P.npy", "--sun", "0,0,1", "--out", out, "--t-min", "1"},
      {"--t-min"});
  Bad(kExitUsage,
      {"shade", obj, "--points", "P.npy", "--sun", "0,0,1", "--out", out, "--attach", "-1"},
      {"--attach"});
  Bad(kExitUsage,
      {"shade", obj, "--points", "P.npy", "--sun", "0,0,1", "--out", out, "--offset", "1"},
      {"--normals"});
  Bad(kExitUsage, {"segments", obj, "--out", out}, {"--segments"});
}

// Of files, built-in scenes and whatever asks for a direction upward.
TEST_F(CliTest, AnUpWithoutADirectionIsAMistakeOfTheCommandLine) {
  const std::string obj = Write("small.obj", kSmallObj), out = File("lit.npy");
  const std::string points = WriteDoubles("points.npy", {1, 2, 3}, 3);
  for (const std::string& scene : {obj, std::string("builtin:box")}) {
    for (const std::vector<std::string>& query : std::vector<std::vector<std::string>>{
             {"view", scene, "--stats"},
             {"relight", scene, "--by", "1,0,0"},
             {"shade", scene, "--points", points, "--sky", "145", "--out", out}}) {
      std::vector<std::string> args = query;
      args.insert(args.end(), {"--up", "0,-0,0"});
      Bad(kExitUsage, args,
          {"--up = (0, -0, 0) has no direction; give a finite vector that is not zero"});
    }
  }
}

// What is built for one query comes to whoever builds it, which refuses what is out of range.
TEST_F(CliTest, FlagsOfWhatIsBuiltReachTheBuilderFromEveryQuery) {
  const std::string obj = Write("small.obj", kSmallObj), out = File("out.npy");
  const std::string points = WriteDoubles("points.npy", {1, 2, 3}, 3);
  const std::string segments = WriteDoubles("segments.npy", {1, 2, 3, 4, 5, 6}, 6);
  for (const std::vector<std::string>& query : std::vector<std::vector<std::string>>{
           {"view", obj, "--stats"},
           {"shade", obj, "--points", points, "--sun", "0,0,1", "--out", out},
           {"segments", obj, "--segments", segments, "--out", out},
           {"relight", obj, "--by", "1,0,0"}}) {
    const auto with = [&](std::vector<std::string> flags) {
      flags.insert(flags.begin(), query.begin(), query.end());
      return flags;
    };
    Bad(kExitData, with({"--structure", "KD_TREE", "--kd-cost", "99"}), {"traversal_cost = 99"});
    Bad(kExitData, with({"--strategy", "RTT", "--kd-max-references", "65"}),
        {"max_references = 65"});
    Bad(kExitData, with({"--structure", "BINARY_BVH", "--binary-cost", "2000"}),
        {"cost_ratio is 2000"});
    Bad(kExitUsage, with({"--kd-depth", "9"}), {"--kd-depth changes nothing"});
    Bad(kExitUsage, with({"--binary-bins", "9", "--strategy", "RTT"}),
        {"--binary-bins changes nothing"});
    std::vector<std::string> held = with({"--build", "dynamic"});
    held[1] = "scenes/x";
    Bad(kExitUsage, held, {"'scenes/x' is built already"});
  }
}

// Of what is built to be kept, too, a flag that changes nothing is refused before a file is read.
TEST_F(CliTest, FlagsOfWhatIsNotBuiltAreRefusedByImportAndLoad) {
  const std::string obj = File("none.obj");
  for (const std::vector<std::string>& command :
       std::vector<std::vector<std::string>>{{"import", obj, "-o", File("none.slscene")},
                                             {"scene", "load", obj, "--server=127.0.0.1:1"}}) {
    const auto with = [&](std::vector<std::string> flags) {
      flags.insert(flags.begin(), command.begin(), command.end());
      return flags;
    };
    Bad(kExitUsage, with({"--kd-cost", "999"}),
        {"--kd-cost changes nothing: a kd-tree is built with --structure kd-tree or both"});
    Bad(kExitUsage, with({"--kd-lay-out-leaves", "--binary-bvh", "--structure", "bvh"}),
        {"--kd-lay-out-leaves changes nothing"});
    Bad(kExitUsage, with({"--binary-bins", "4", "--structure", "both"}),
        {"--binary-bins changes nothing: a binary BVH is built with --binary-bvh"});
    Bad(kExitUsage, with({"--build", "compact", "--structure", "kd-tree"}),
        {"--build changes nothing: no BVH is built with --structure kd-tree"});
    // What is built is looked for.
    Bad(kExitNoInput,
        with({"--structure", "kd-tree", "--kd-cost", "2", "--binary-bvh", "--binary-bins", "4"}),
        {"none.obj"});
  }
  for (const std::vector<std::string>& flag :
       std::vector<std::vector<std::string>>{{"--build", "static"},
                                             {"--structure", "bvh"},
                                             {"--kd-depth", "9"},
                                             {"--binary-bvh"},
                                             {"--binary-cost", "1"}}) {
    std::vector<std::string> args = {"scene", "load", "scenes/x", "--server=127.0.0.1:1"};
    args.insert(args.end(), flag.begin(), flag.end());
    Bad(kExitUsage, args, {flag[0] + " changes nothing: 'scenes/x' is built already"});
  }
}

TEST_F(CliTest, ArraysOfTheWrongShape) {
  const std::string obj = Write("small.obj", kSmallObj), out = File("lit.npy");
  const std::string four = WriteDoubles("four.npy", {1, 2, 3, 4}, 4);
  Bad(kExitData, {"shade", obj, "--points", four, "--sun", "0,0,1", "--out", out},
      {"four.npy", "(1, 4)"});
  Bad(kExitData, {"segments", obj, "--segments", four, "--out", out}, {"four.npy", "(n, 6)"});
  Bad(kExitData, {"segments", obj, "--segments", Write("cut.npy", "\x93NUMPY\x01"), "--out", out},
      {"cut.npy"});
  Bad(kExitNoInput, {"segments", obj, "--segments", File("none.npy"), "--out", out}, {"none.npy"});
  Bad(kExitData,
      {"shade", obj, "--points", Write("P.csv", "1,2,3\n1,2,z\n"), "--sun", "0,0,1", "--out", out},
      {"P.csv", "line 2"});
  const std::string points = WriteDoubles("P.npy", {1, 2, 3}, 3);
  Bad(kExitData,
      {"shade", obj, "--points", points, "--lights", WriteDoubles("L.npy", {}, 3), "--out", out},
      {"L.npy", "no light"});
}

TEST_F(CliTest, OutputsThatCannotBeWrittenAreToldFirst) {
  Bad(kExitCannotCreate, {"view", "builtin:forest:10M", "--out", File("no/such/folder/v.png")},
      {"v.png"});
  Bad(kExitCannotCreate,
      {"segments", File("none.obj"), "--segments", "S.npy", "--out", dir_.path()}, {dir_.path()});
}

// Who may talk to a server is told by files, and those are input like any other.
TEST_F(CliTest, CertificatesAndTokensThatCannotBeUsed) {
  const std::string none = File("none.pem"), server = "--server=127.0.0.1:1";
  const testing_support::TestAuthority authority("authority");
  const auto issued = authority.Issue({.common_name = "client"});
  const std::string there = Write("there", issued.certificate), below = there + "/ca.pem";
  const auto with = [&](const std::vector<std::string>& flags) {
    std::vector<std::string> args = {"health", server, "--retry=0"};
    args.insert(args.end(), flags.begin(), flags.end());
    return args;
  };
  std::filesystem::permissions(there, std::filesystem::perms::owner_read);
  Bad(kExitNoInput, with({"--tls-ca", none}), {none});
  Bad(kExitNoInput, with({"--tls-ca", below}), {below});
  Bad(kExitNoInput, with({"--tls-cert", none, "--tls-key", there}), {none});
  Bad(kExitNoInput, with({"--tls-cert", there, "--tls-key", none}), {none});
  Bad(kExitNoInput, with({"--token-file", none}), {none});
  Bad(kExitNoInput, {"view", "scenes/x", server, "--tls-ca", none, "--out", File("v.png")}, {none});
  Bad(kExitData, with({"--tls-ca", dir_.path()}), {dir_.path(), "not a regular file"});
  const std::string large = Write("large", std::string((1 << 20) + 1, 'x'));
  Bad(kExitData, with({"--tls-ca", large}), {large, "has more than 1048576 bytes"});
  Bad(kExitData, with({"--tls-ca", Write("other", "x")}), {"other", "no CERTIFICATE in PEM form"});
  // Its frame is whole, and what is within is not.
  std::string broken = issued.certificate;
  broken[broken.size() / 2] = '*';
  Bad(kExitData, with({"--tls-ca", Write("broken", broken)}), {"broken", "a broken CERTIFICATE"});
  const std::string key =
      Write("key", authority.Issue({.common_name = "another"}).key + issued.certificate);
  std::filesystem::permissions(key, std::filesystem::perms::owner_read);
  Bad(kExitData, with({"--tls-cert", there, "--tls-key", key}), {key, "is not the key of", there});
  // Others may read it.
  std::filesystem::permissions(there, std::filesystem::perms::others_read,
                               std::filesystem::perm_options::add);
  Bad(kExitNoInput, with({"--token-file", there}), {there, "chmod 600"});
  // What no file can mend.
  Bad(kExitUsage, with({"--tls-cert", there}), {"its key"});
  Bad(kExitUsage, {"health", "--server=far.org:1", "--token-file", none}, {"in the clear"});
  Bad(kExitUsage, {"view", "builtin:box", "--tls-ca", none, "--out", File("v.png")},
      {"--tls-ca goes with --server"});
}

// Nobody writes to the pipe: whoever waits for that never ends.
TEST_F(CliTest, PipesAreNoFiles) {
  const std::string server = "--server=127.0.0.1:1", out = File("v.png");
  const std::string ends[] = {".obj", ".stl.xz", ".glb", ".3ds", ".slscene", ""};
  for (const std::string& end : ends) {
    ASSERT_EQ(mkfifo(File("pipe" + end).c_str(), 0600), 0);
    if (end.empty()) continue;
    Bad(kExitData, {"check", File("pipe" + end)}, {"pipe" + end, "file"});
    Bad(kExitData, {"view", File("pipe" + end), "--out", out}, {"pipe" + end, "file"});
  }
  const std::string pipe = File("pipe");
  Bad(kExitData, {"health", server, "--token-file", pipe}, {pipe, "not a regular file"});
  Bad(kExitData, {"health", server, "--tls-ca", pipe}, {pipe, "not a regular file"});
  const std::string good =
      Write("good", testing_support::TestAuthority("a").Issue({.common_name = "c"}).certificate);
  Bad(kExitData, {"health", server, "--tls-cert", pipe, "--tls-key", good}, {pipe, "regular"});
  Bad(kExitData, {"health", server, "--tls-cert", good, "--tls-key", pipe}, {pipe, "regular"});
}

TEST_F(CliTest, ServersThatAreNotThere) {
  // A port that was free a moment ago: nobody listens on it now.
  int port = 0;
  {
    const std::unique_ptr<Server> server = StartServer();
    ASSERT_NE(server, nullptr);
    port = server->port();
  }
  const std::string flag = absl::StrCat("--server=127.0.0.1:", port);
  Bad(kExitUnavailable, {"health", flag, "--retry", "0"}, {});
  Bad(kExitUnavailable, {"view", Write("small.obj", kSmallObj), flag, "--retry", "0", "--stats"},
      {});
}

// Nothing is taken for answers that would not be kept.
TEST_F(CliTest, AnswersAreBounded) {
  const std::string obj = Write("small.obj", kSmallObj), out = File("out");
  const std::string rows = WriteDoubles("rows.npy", std::vector<double>(3 * 70'000, 1.0), 3);
  Bad(kExitUsage, {"shade", obj, "--points", rows, "--lights", rows, "--out", out},
      {"70000 lights at 70000 points are 4900000000 answers; at most 4294967296 are kept: ",
       "fewer lights, or the points in several files"});
  for (const char* command : {"view", "relight"}) {
    std::vector<std::string> args = {command, obj, "--size=1920x1080", "--sky=2305"};
    args.insert(args.end(), {"--out", out + ".png"});
    if (args[0] == "relight") args.emplace_back("--by=1,0,0");
    Bad(kExitUsage, args, {"2305 lights at 2073600 pixels are 4779648000 answers", "--size"});
  }
}

}  // namespace
}  // namespace sightline::cli
