// SPDX-License-Identifier: Apache-2.0
#include "server/option_sources.h"

#include <fstream>
#include <map>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_replace.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "server/client_part.h"
#include "server/config_file.h"
#include "tests/support/temp_dir.h"

namespace sightline {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

class OptionSourcesTest : public ::testing::Test {
 protected:
  // A file with `text`.
  std::string Config(const std::string& text) const {
    std::ofstream(dir_.File("sightlined.yaml")) << text;
    return dir_.File("sightlined.yaml");
  }
  static absl::StatusOr<ParsedOptions> Read(std::vector<std::string> flags,
                                            std::vector<std::string> variables = {}) {
    std::vector<const char*> argv = {"sightlined"}, environment;
    for (const std::string& flag : flags) argv.push_back(flag.c_str());
    for (const std::string& variable : variables) environment.push_back(variable.c_str());
    environment.push_back(nullptr);
    return ReadOptions(static_cast<int>(argv.size()), argv.data(), environment.data());
  }
  static std::string ErrorOf(const absl::StatusOr<ParsedOptions>& parsed) {
    EXPECT_EQ(parsed.status().code(), absl::StatusCode::kInvalidArgument);
    return std::string(parsed.status().message());
  }

  const testing_support::TempDir dir_;
};

TEST_F(OptionSourcesTest, FlagBeatsEnvironmentBeatsFileBeatsDefault) {
  const std::string file = Config(
      "threads: 1\nbuild-threads: 1\nmax_scenes: 1\nscene: [a=builtin:box, b=builtin:box]\n");
  const std::vector<std::string> variables = {"SIGHTLINE_THREADS=2", "SIGHTLINE_BUILD_THREADS=2",
                                              "PATH=x", "SIGHTLINE_SCENE=c=builtin:box "};
  const absl::StatusOr<ParsedOptions> parsed = Read({"--threads=3", "--config", file}, variables);
  ASSERT_TRUE(parsed.ok()) << parsed.status();
  EXPECT_EQ(parsed->options.threads, 3);
  EXPECT_EQ(parsed->options.build_threads, 2);
  EXPECT_EQ(parsed->options.limits.max_scenes, 1u);
  EXPECT_EQ(parsed->options.limits.max_lights, Limits().max_lights);
  // Sources are not mixed.
  EXPECT_THAT(parsed->options.scenes, ElementsAre("c=builtin:box"));
  EXPECT_THAT(parsed->warnings, IsEmpty());
  EXPECT_EQ(parsed->given.at("threads").origin, "--threads");
  EXPECT_EQ(parsed->given.at("build-threads").origin, "SIGHTLINE_BUILD_THREADS");
  EXPECT_EQ(parsed->given.at("max-scenes").origin, file + ":3: max-scenes");
  EXPECT_EQ(parsed->given.count("max-lights"), 0u);
}

// As deployments write them for what is not set: VARIABLE=${OTHER}.
TEST_F(OptionSourcesTest, AnEmptyVariableIsNone) {
  const std::string file =
      Config("listen: 127.0.0.1:7\nscene: builtin:box\naccess-file: a\nthreads: 3\n");
  const absl::StatusOr<ParsedOptions> parsed =
      Read({"--config", file}, {"SIGHTLINE_LISTEN=", "SIGHTLINE_SCENE=  ", "SIGHTLINE_ACCESS_FILE=",
                                "SIGHTLINE_THREADS=", "SIGHTLINE_CONFIG="});
  ASSERT_TRUE(parsed.ok()) << parsed.status();
  EXPECT_THAT(parsed->options.listen, ElementsAre("127.0.0.1:7"));
  EXPECT_THAT(parsed->options.scenes, ElementsAre("builtin:box"));
  EXPECT_EQ(parsed->options.access_file, "a");
  EXPECT_EQ(parsed->options.threads, 3);
  ASSERT_EQ(parsed->warnings.size(), 5u);
  EXPECT_EQ(parsed->warnings[0], "the variable SIGHTLINE_LISTEN is empty and is ignored");
  EXPECT_TRUE(Read({"--config", Config(ConfigText(*parsed))}).ok());
  // Without a file the default stands; a flag that is empty says what it says.
  EXPECT_EQ(Read({}, {"SIGHTLINE_LISTEN="})->options.listen, ServerOptions().listen);
  EXPECT_EQ(Read({"--config", file, "--access-file="})->options.access_file, "");
}

TEST_F(OptionSourcesTest, TheEnvironmentNamesTheFileToo) {
  const std::string file = Config("threads: 5\n");
  EXPECT_EQ(Read({}, {"SIGHTLINE_CONFIG=" + file})->options.threads, 5);
  // A flag's file takes the place of the variable's.
  EXPECT_EQ(Read({"--config=" + file}, {"SIGHTLINE_CONFIG=none"})->options.threads, 5);
  EXPECT_EQ(Read({}, {"SIGHTLINE_CONFIG=" + dir_.File("none")}).status().code(),
            absl::StatusCode::kNotFound);
}

TEST_F(OptionSourcesTest, TheLastOfAFlagCounts) {
  EXPECT_EQ(Read({"--threads=3", "--threads=4"})->options.threads, 4);
  EXPECT_THAT(Read({"--scene=x", "--scene=y"})->options.scenes, ElementsAre("x", "y"));
}

TEST_F(OptionSourcesTest, UnknownNamesSuggestTheNearest) {
  EXPECT_THAT(ErrorOf(Read({"--thread=2"})),
              HasSubstr("there is no flag --thread; did you mean --threads?"));
  const std::string file = Config("threads: 1\n\nmax-scnes: 3\n");
  EXPECT_THAT(ErrorOf(Read({"--config", file})),
              HasSubstr(file + ":3: there is no option \"max-scnes\"; did you mean max-scenes?"));
  EXPECT_THAT(ErrorOf(Read({"--config", Config("qwertz: 3\n")})),
              ::testing::EndsWith("there is no option \"qwertz\""));
  // Variables that nobody meant for us are named and ignored.
  const absl::StatusOr<ParsedOptions> parsed =
      Read({}, {"SIGHTLINE_THREAD=2", "SIGHTLINE_SERVICE_HOST=10.0.0.1", "SIGHTLINE_HELP=1"});
  ASSERT_TRUE(parsed.ok()) << parsed.status();
  EXPECT_EQ(parsed->options.threads, 0);
  EXPECT_FALSE(parsed->help);
  ASSERT_EQ(parsed->warnings.size(), 3u);
  EXPECT_THAT(parsed->warnings[0], HasSubstr("did you mean SIGHTLINE_THREADS?"));
  EXPECT_THAT(parsed->warnings[1], HasSubstr("SIGHTLINE_SERVICE_HOST"));
}

TEST_F(OptionSourcesTest, WhatHasNoEffectIsSaid) {
  const auto parsed =
      Read({"--load=none", "--evict=lru", "--scene-files=read", "--tls-client-auth=optional",
            "--unix-socket-mode=0660", "--listen=127.0.0.1:0"});
  ASSERT_TRUE(parsed.ok()) << parsed.status();
  EXPECT_THAT(parsed->warnings,
              ElementsAre("--load = none has no effect without --repository",
                          "--scene-files = read has no effect without --repository",
                          "--evict = lru has no effect without --repository",
                          "--tls-client-auth = optional has no effect without --tls-client-ca",
                          "--unix-socket-mode = 0660 has no effect without --listen unix:PATH"));
  const auto useful =
      Read({"--load=none", "--evict=lru", "--repository=r", "--tls-client-auth=optional",
            "--tls-client-ca=ca.pem", "--unix-socket-mode=0660", "--listen=unix:s"});
  ASSERT_TRUE(useful.ok()) << useful.status();
  EXPECT_THAT(useful->warnings, IsEmpty());
}

TEST_F(OptionSourcesTest, ErrorsNameTheSource) {
  const std::string file = Config("log-level: info\nthreads: many\n");
  EXPECT_THAT(ErrorOf(Read({"--config", file})), HasSubstr(file + ":2: threads = \"many\""));
  EXPECT_THAT(ErrorOf(Read({}, {"SIGHTLINE_MAX_SCENES=0"})),
              HasSubstr("SIGHTLINE_MAX_SCENES = \"0\": must be 1 .. "));
  // What a stronger source decides is not looked at, however wrong.
  EXPECT_TRUE(Read({"--config", file, "--threads=2"}).ok());
  EXPECT_THAT(ErrorOf(Read({"--config", Config("threads: [1, 2]\n")})), HasSubstr("not a list"));
  EXPECT_THAT(ErrorOf(Read({"--config", Config("max-scenes: 1\nmax_scenes: 2\n")})),
              HasSubstr(file + ":2: \"max_scenes\" is given already, at " + file + ":1"));
  EXPECT_THAT(ErrorOf(Read({"--config", Config("version: yes\n")})), HasSubstr("command line"));
  EXPECT_THAT(ErrorOf(Read({"--config", Config("config: x\n")})), HasSubstr("command line"));
}

TEST_F(OptionSourcesTest, TheConfigTextGivesTheSameOptionsAgain) {
  const std::string file = Config("drain-timeout: 7s\nscene: ['a=builtin:box,seed=2']\n");
  const absl::StatusOr<ParsedOptions> first =
      Read({"--config", file, "--scene=x=builtin:hall", "--scene=builtin:box,seed=3",
            "--port-file=a # b: c", "--max-scenes=7"},
           {"SIGHTLINE_THREADS=2"});
  ASSERT_TRUE(first.ok()) << first.status();
  const std::string text = ConfigText(*first);
  EXPECT_THAT(text, HasSubstr("threads: 2  # SIGHTLINE_THREADS\n"));
  EXPECT_THAT(text, HasSubstr("drain-timeout: 7s  # " + file + ":1: drain-timeout\n"));
  EXPECT_THAT(text, HasSubstr("max-scenes: 7  # --max-scenes\n"));
  EXPECT_THAT(text, HasSubstr("# build-threads: 0  # default\n"));
  const absl::StatusOr<ParsedOptions> second = Read({"--config", Config(text)});
  ASSERT_TRUE(second.ok()) << second.status() << "\n" << text;
  EXPECT_EQ(second->options.scenes, first->options.scenes);
  EXPECT_EQ(second->options.port_file, first->options.port_file);
  EXPECT_EQ(second->options.threads, 2);
  EXPECT_EQ(second->options.drain_timeout, absl::Seconds(7));
  EXPECT_EQ(second->options.limits.max_scenes, 7u);
}

// Every option, and texts that mean something else in YAML unless they are quoted.
TEST_F(OptionSourcesTest, TheConfigTextOfEveryOptionIsRead) {
  const std::map<std::string, std::string> good = {{"unix-socket-mode", "0660"},
                                                   {"tls-client-auth", "optional"},
                                                   {"reload-interval", "1m"},
                                                   {"load", "none"},
                                                   {"scene-files", "read"},
                                                   {"evict", "lru"},
                                                   {"threads", "2"},
                                                   {"build-threads", "2"},
                                                   {"drain-delay", "1s"},
                                                   {"drain-timeout", "1s"},
                                                   {"connection-idle-timeout", "none"},
                                                   {"slow-query-log", "none"},
                                                   {"log-level", "off"}};
  const std::vector<std::string> awkward = {
      "a # b: c", "~",   "null", "yes",  "it's \"so\"", "[x", "{x",   "- x",
      "a, b",     " x ", "a\nb", "a\tb", "&a",          "*a", "!a",   "%a",
      "@a",       "`a",  "|",    ">",    "?",           ":",  "0x10", "\xC3\xA9"};
  std::map<std::string, std::string> limits;
  for (const LimitEntry& entry : LimitTable()) {
    limits[absl::StrReplaceAll(entry.name, {{"_", "-"}})] = absl::StrCat(entry.least);
  }
  std::vector<std::string> flags;
  for (const Option& option : OptionTable()) {
    if (option.takes.empty() || option.name == "config") continue;
    const auto give = [&](const std::string& value) {
      flags.push_back(absl::StrCat("--", option.name, "=", value));
    };
    if (const auto known = good.find(option.name); known != good.end()) {
      give(known->second);
    } else if (const auto limit = limits.find(option.name); limit != limits.end()) {
      give(limit->second);
    } else if (option.repeated) {
      for (const std::string& text : awkward) give(text);
    } else {
      give(awkward[flags.size() % awkward.size()]);
    }
  }
  for (const std::string& text : awkward) {
    flags.push_back(absl::StrCat("--port-file=", text));  // The last one counts.
    const absl::StatusOr<ParsedOptions> first = Read(flags);
    ASSERT_TRUE(first.ok()) << first.status();
    const std::string printed = ConfigText(*first);
    const absl::StatusOr<ParsedOptions> second = Read({"--config", Config(printed)});
    ASSERT_TRUE(second.ok()) << second.status() << "\n" << printed;
    for (const auto& [name, option] : first->given) {
      ASSERT_TRUE(second->given.contains(name)) << name << "\n" << printed;
      const std::vector<std::string>& values = second->given.at(name).values;
      EXPECT_EQ(values, option.values) << name << "\n" << printed;
    }
  }
  // Nothing is a value, too.
  const std::string nothing = ConfigText(*Read({"--access-file="}));
  EXPECT_EQ(Read({"--config", Config(nothing)})->given.count("access-file"), 1u) << nothing;
}

TEST_F(OptionSourcesTest, AClientsPartIsHalfOfWhatAllHave) {
  const auto usual = Read({});
  ASSERT_TRUE(usual.ok()) << usual.status();
  for (const LimitEntry& entry : LimitTable()) {
    EXPECT_TRUE(TotalOf(entry.name) == nullptr ||
                usual->options.limits.*entry.value == Limits().*entry.value)
        << entry.name;
  }
  const auto lowered = Read({"--max-connections=300", "--max-concurrent-uploads=1",
                             "--max-queued-rays=4096", "--max-queued-rays-per-client=4000"});
  ASSERT_TRUE(lowered.ok()) << lowered.status();
  EXPECT_EQ(lowered->options.limits.max_connections_per_address, 150u);
  EXPECT_EQ(lowered->options.limits.max_concurrent_uploads_per_client, 1u);
  EXPECT_EQ(lowered->options.limits.max_queued_rays_per_client, 4000u);
  EXPECT_THAT(
      ConfigText(*lowered),
      HasSubstr("# max-connections-per-address: 150  # default: half of max-connections\n"));
  EXPECT_THAT(HelpText(), HasSubstr("(default: 500, half of max-connections)"));
}

TEST_F(OptionSourcesTest, WhatTheOptionsNameIsChecked) {
  ServerOptions options;
  options.scenes = {"builtin:box", "a=builtin:hall:30k,seed=3"};
  EXPECT_TRUE(CheckOptions(options).ok());
  EXPECT_EQ(ParseSceneOption(options.scenes[1])->id, "a");
  EXPECT_EQ(ParseSceneOption("builtin:hall,seed=7")->id, "hall");
  for (const char* scene : {"hall.obj", "builtin:hal", "A B=builtin:hall", "builtin:hall:-1"}) {
    options.scenes = {scene};
    EXPECT_EQ(CheckOptions(options).code(), absl::StatusCode::kInvalidArgument) << scene;
  }
  // A name for two.
  options.scenes = {"builtin:hall:30k", "builtin:box", "hall=builtin:box"};
  const absl::Status twice = CheckOptions(options);
  EXPECT_EQ(twice.code(), absl::StatusCode::kInvalidArgument);
  EXPECT_THAT(std::string(twice.message()), HasSubstr("\"hall=builtin:box\": the name hall"));
  EXPECT_THAT(std::string(twice.message()), HasSubstr("\"builtin:hall:30k\""));
}

}  // namespace
}  // namespace sightline
