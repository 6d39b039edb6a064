// SPDX-License-Identifier: Apache-2.0
#include "server/options.h"

#include <cerrno>
#include <set>
#include <string>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_replace.h"
#include "gtest/gtest.h"
#include "server/machine_memory.h"
#include "server/option_sources.h"
#include "server/services/capability_service.h"
#include "tests/support/faulty_file_calls.h"

namespace sightline {
namespace {

absl::StatusOr<ParsedOptions> Parse(std::vector<const char*> arguments) {
  arguments.insert(arguments.begin(), "sightlined");
  return ReadOptions(static_cast<int>(arguments.size()), arguments.data(), nullptr);
}

TEST(OptionsTest, DefaultsToLoopbackOnAFreePort) {
  const absl::StatusOr<ParsedOptions> parsed = Parse({});
  ASSERT_TRUE(parsed.ok());
  EXPECT_EQ(parsed->options.listen, std::vector<std::string>{"127.0.0.1:0"});
  EXPECT_TRUE(ValidateLimits(parsed->options.limits).ok());
}

TEST(OptionsTest, ReadsBothFormsAndBothSpellings) {
  const absl::StatusOr<ParsedOptions> parsed = Parse(
      {"--listen=[::1]:9000", "--listen", "unix:run/s", "--unix-socket-mode=0660", "--port_file",
       "port", "--scene", "a=builtin:hall:10k", "--scene=builtin:room", "--threads", "3",
       "--drain-timeout=1m30s", "--drain-delay=5s", "--max-item-rays=12345", "--log-level=debug"});
  ASSERT_TRUE(parsed.ok()) << parsed.status();
  EXPECT_EQ(parsed->options.listen, (std::vector<std::string>{"[::1]:9000", "unix:run/s"}));
  EXPECT_EQ(parsed->options.unix_socket_mode, 0660);
  EXPECT_EQ(parsed->options.port_file, "port");
  EXPECT_EQ(parsed->options.scenes,
            (std::vector<std::string>{"a=builtin:hall:10k", "builtin:room"}));
  EXPECT_EQ(parsed->options.threads, 3);
  EXPECT_EQ(parsed->options.drain_timeout, absl::Seconds(90));
  EXPECT_EQ(parsed->options.drain_delay, absl::Seconds(5));
  EXPECT_EQ(parsed->options.limits.max_item_rays, 12345u);
  EXPECT_EQ(parsed->options.log_level, LogLevel::kDebug);
}

TEST(OptionsTest, NoneIsAsGoodAsNoSlowQueryLog) {
  EXPECT_EQ(Parse({"--slow-query-log=2s"})->options.slow_query_log, absl::Seconds(2));
  EXPECT_EQ(Parse({"--slow-query-log=none"})->options.slow_query_log, absl::InfiniteDuration());
  EXPECT_FALSE(Parse({"--slow-query-log=never"}).ok());
}

TEST(OptionsTest, NoneIsAsGoodAsNoIdleTimeout) {
  EXPECT_EQ(ServerOptions().connection_idle_timeout, absl::Minutes(30));
  EXPECT_EQ(Parse({"--connection-idle-timeout=5m"})->options.connection_idle_timeout,
            absl::Minutes(5));
  EXPECT_EQ(Parse({"--connection-idle-timeout=none"})->options.connection_idle_timeout,
            absl::InfiniteDuration());
}

// The budgets of a server that was told none are shares of the memory that it may take.
TEST(OptionsTest, BudgetsKnowTheMachine) {
  const uint64_t memory = ThisMachinesMemory().bytes;
  const absl::StatusOr<ParsedOptions> parsed = Parse({"--max-bytes-per-scene=2000000"});
  ASSERT_TRUE(parsed.ok()) << parsed.status();
  EXPECT_EQ(parsed->options.limits.max_scene_bytes, memory / 8 * 5);
  EXPECT_EQ(parsed->options.limits.max_point_set_bytes, memory / 8);
  EXPECT_EQ(parsed->options.limits.max_bytes_per_scene, 2'000'000u);
  const std::string text = ConfigText(*parsed);
  EXPECT_TRUE(absl::StrContains(text, absl::StrCat("# max-scene-bytes: ", memory / 8 * 5,
                                                   "  # default: five eighths of the memory of ",
                                                   ThisMachinesMemory().origin, "\n")))
      << text;
  EXPECT_TRUE(absl::StrContains(text, "# max-scenes: 1000  # default\n")) << text;
}

TEST(OptionsTest, TheRepository) {
  const ServerOptions defaults;
  EXPECT_TRUE(defaults.repository.empty() && defaults.load_repository);
  EXPECT_FALSE(defaults.evict_least_used);
  const absl::StatusOr<ParsedOptions> parsed =
      Parse({"--repository=/", "--load=none", "--evict=lru", "--scene-files=read"});
  ASSERT_TRUE(parsed.ok()) << parsed.status();
  EXPECT_EQ(parsed->options.repository, "/");
  EXPECT_FALSE(parsed->options.load_repository);
  EXPECT_TRUE(parsed->options.evict_least_used);
  EXPECT_EQ(defaults.scene_files, SceneFiles::kMapped);
  EXPECT_EQ(parsed->options.scene_files, SceneFiles::kRead);
  EXPECT_TRUE(CheckOptions(parsed->options).ok());
  const absl::Status none = CheckOptions({.repository = "/no/such/folder"});
  EXPECT_EQ(none.code(), absl::StatusCode::kInvalidArgument);
  EXPECT_TRUE(absl::StrContains(none.message(), "/no/such/folder")) << none;
}

TEST(OptionsTest, ARepositoryThatCannotBeWrittenIsForeseen) {
  testing_support::FaultyFileCalls calls;
  ServerOptions options;
  options.files = &calls;
  calls.access_error = EROFS;
  EXPECT_TRUE(ForeseenTroubles(options).empty());
  options.repository = "/";
  EXPECT_TRUE(CheckOptions(options).ok());  // What is in it can be served.
  const std::vector<std::string> troubles = ForeseenTroubles(options);
  ASSERT_EQ(troubles.size(), 1u);
  EXPECT_TRUE(absl::StrContains(troubles[0], "--repository: cannot write to the folder /"))
      << troubles[0];
  calls.access_error = 0;
  calls.open_error = EACCES;
  EXPECT_TRUE(ForeseenTroubles(options).empty());
}

TEST(OptionsTest, ErrorsNameTheFlagAndTheValue) {
  const std::vector<std::pair<std::vector<const char*>, const char*>> cases = {
      {{"serve"}, "serve"},
      {{"--no-such"}, "no-such"},
      {{"--threads"}, "threads"},
      {{"--threads=many"}, "many"},
      {{"--threads=-1"}, "-1"},
      {{"--drain-timeout=30"}, "30"},
      {{"--log-level=loud"}, "loud"},
      {{"--max-scenes=0"}, "max-scenes"},
      {{"--max-scenes=99999999999999999999"}, "max-scenes"},
      {{"--load=some"}, "all or none"},
      {{"--evict=random"}, "lru or none"},
      {{"--scene-files=copied"}, "mapped or read"},
      {{"--connection-idle-timeout=1ms"}, "at least 100ms"},
      {{"--help=yes"}, "help"},
      {{"--unix-socket-mode=rw"}, "octal"},
      {{"--tls-client-auth=never"}, "required or optional"},
      {{"--reload-interval=1ms"}, "at least 100ms"},
  };
  for (const auto& [arguments, named] : cases) {
    const absl::Status status = Parse(arguments).status();
    EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument);
    EXPECT_TRUE(absl::StrContains(status.message(), named)) << status;
  }
}

TEST(OptionsTest, HelpNamesEveryLimit) {
  const std::string help = HelpText();
  for (const LimitEntry& entry : LimitTable()) {
    EXPECT_TRUE(absl::StrContains(
        help, absl::StrCat("--", absl::StrReplaceAll(entry.name, {{"_", "-"}}), " ")))
        << entry.name;
  }
  EXPECT_TRUE(Parse({"--help"})->help);
  EXPECT_TRUE(Parse({"--version"})->version);
}

TEST(OptionsTest, WhatBelongsTogetherIsAskedForTogether) {
  const std::vector<std::pair<std::vector<const char*>, const char*>> cases = {
      {{"--tls-cert=a"}, "come together"},
      {{"--tls-key=a"}, "come together"},
      {{"--tls-client-ca=a"}, "wants --tls-cert"},
      {{"--tls-cert=no-such-file", "--tls-key=no-such-file"}, "no-such-file"},
      {{"--access-file=no-such-file"}, "no-such-file"},
      {{"--listen=7070"}, "--listen = \"7070\": must be HOST:PORT"},
      {{"--listen=127.0.0.1:7070", "--listen=127.0.0.1:7070"}, "is given twice"},
      {{"--listen=127.0.0.1:7070", "--metrics-listen=127.0.0.1:7070"}, "is given twice"},
      {{"--scene=a=builtin:nothing"}, "--scene = \"a=builtin:nothing\": "},
      {{"--metrics-listen=7070"}, "--metrics-listen = \"7070\": must be HOST:PORT"},
      {{"--metrics-listen=unix:s"}, "not a Unix socket"},
  };
  for (const auto& [arguments, named] : cases) {
    const absl::StatusOr<ParsedOptions> parsed = Parse(arguments);
    ASSERT_TRUE(parsed.ok()) << parsed.status();
    const absl::Status status = CheckOptions(parsed->options);
    EXPECT_FALSE(status.ok());
    EXPECT_TRUE(absl::StrContains(status.message(), named)) << status;
  }
}

// Port 0 is another one each time.
TEST(OptionsTest, FreePortsMayBeAskedForMoreThanOnce) {
  const absl::StatusOr<ParsedOptions> parsed =
      Parse({"--listen=127.0.0.1:0", "--listen=127.0.0.1:0", "--metrics-listen=127.0.0.1:0"});
  ASSERT_TRUE(parsed.ok()) << parsed.status();
  EXPECT_TRUE(CheckOptions(parsed->options).ok()) << CheckOptions(parsed->options);
}

TEST(LimitsTest, EveryPublishedLimitIsSetAndEveryLimitIsPublished) {
  const v1::Capabilities capabilities = DescribeServer(Limits{}, 3);
  const v1::Limits& limits = capabilities.limits();
  const google::protobuf::Descriptor* descriptor = limits.GetDescriptor();
  for (int i = 0; i < descriptor->field_count(); ++i) {
    const google::protobuf::FieldDescriptor* field = descriptor->field(i);
    std::vector<const google::protobuf::FieldDescriptor*> set;
    limits.GetReflection()->ListFields(limits, &set);
    EXPECT_NE(std::find(set.begin(), set.end(), field), set.end()) << field->full_name();
  }
  // All but max_coordinate come from the table.
  EXPECT_EQ(static_cast<size_t>(descriptor->field_count()), LimitTable().size() + 1);
  EXPECT_EQ(limits.max_pin_duration().seconds(), 3600);
  EXPECT_EQ(limits.max_lease().seconds(), 24 * 3600);
  EXPECT_EQ(capabilities.thread_count(), 3u);
  EXPECT_GT(capabilities.builtin_scenes_size(), 0);
  EXPECT_EQ(capabilities.strategies(0), v1::STRATEGY_AUTO);
  EXPECT_FALSE(capabilities.instruction_set().empty());
}

TEST(LimitsTest, ValidateNamesTheLimit) {
  Limits limits;
  limits.max_message_bytes = 10;
  const absl::Status status = ValidateLimits(limits);
  EXPECT_TRUE(absl::StrContains(status.message(), "max_message_bytes = 10")) << status;
}

// More triangles or vertices than the engine numbers: no flag lets them in.
TEST(LimitsTest, NoSceneIsLetGrowBeyondWhatTheEngineNumbers) {
  for (uint64_t Limits::*limit :
       {&Limits::max_triangles_per_scene, &Limits::max_vertices_per_scene}) {
    Limits limits;
    limits.*limit = kMaxGeometryItems;
    EXPECT_TRUE(ValidateLimits(limits).ok());
    limits.*limit = kMaxGeometryItems + 1;
    const absl::Status status = ValidateLimits(limits);
    EXPECT_TRUE(absl::StrContains(status.message(), "_per_scene = 715827883 is outside")) << status;
    EXPECT_TRUE(absl::StrContains(status.message(), ".. 715827882")) << status;
  }
}

}  // namespace
}  // namespace sightline
