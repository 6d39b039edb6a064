// SPDX-License-Identifier: Apache-2.0
//
// `sightline` interrupted: in the test's own process before it began and while it opens a scene,
// and as a process that is sent signals where it would go on for long.
#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <csignal>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <thread>
#include <tuple>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/synchronization/notification.h"
#include "client/cli/interruption.h"
#include "client/cli/native_scene.h"
#include "client/lib/client.h"
#include "client/lib/connection.h"
#include "core/base/parallel.h"
#include "core/mesh/builtin/builtin.h"
#include "core/scene/scene.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "tests/integration/cli/cli_testing.h"
#include "tests/integration/serving_process.h"
#include "tests/integration/terminal_process.h"
#include "tests/support/watched_stream.h"

namespace sightline::cli {
namespace {

using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;

constexpr char kGivenUp[] = "interrupted before it was done";

std::vector<std::string> ScenesAt(const std::string& address) {
  std::vector<std::string> names;
  const client::Client client(client::MakeConnection(address, {}));
  const absl::StatusOr<std::vector<client::Scene>> scenes = client.ListScenes();
  EXPECT_TRUE(scenes.ok()) << scenes.status();
  if (!scenes.ok()) return names;
  for (const client::Scene& scene : *scenes) names.push_back(scene.name);
  return names;
}

class CliInterruptionTest : public CliTest {
 protected:
  void SetUp() override {
    obj_ = Write("small.obj", kSmallObj);
    points_ = WriteDoubles("points.npy", {1, 1, 1}, 3);
    segments_ = WriteDoubles("segments.npy", {1, 1, 1, 8, 1, 1}, 6);
  }
  // Commands that make a scene of `scene`, without what they write.
  std::vector<std::vector<std::string>> Queries(const std::string& scene) const {
    return {{"view", scene, "--size=32x24", "--out", out_},
            {"relight", scene, "--size=32x24", "--by=1,0,0", "--out", out_},
            {"shade", scene, "--points", points_, "--light=5,5,9", "--out", out_},
            {"segments", scene, "--segments", segments_, "--out", out_}};
  }
  void ExpectNoOutput() const {
    for (const auto& entry : std::filesystem::directory_iterator(dir_.path())) {
      EXPECT_FALSE(absl::StrContains(entry.path().string(), "out.")) << entry.path();
    }
  }

  std::string obj_, points_, segments_, out_ = File("out.png");
};

TEST_F(CliInterruptionTest, NothingIsDoneOnceInterrupted) {
  const std::string native = File("small.slscene");
  Good({"import", obj_, "-o", native});
  const auto server = StartServer();
  const std::string at = ServerFlag(*server);
  std::vector<std::vector<std::string>> commands = Queries(obj_);
  for (const std::string& scene : {obj_, native, std::string("builtin:box")}) {
    for (std::vector<std::string> command : Queries(scene)) {
      commands.push_back(command);
      if (scene == native) continue;
      command.push_back(at);
      commands.push_back(command);
    }
  }
  commands.push_back({"import", obj_, "-o", File("out.slscene")});
  commands.push_back({"check", obj_});
  commands.push_back({"check", native});
  commands.push_back({"health"});
  commands.push_back({"health", at});
  commands.push_back({"scene", "load", obj_, at});
  commands.push_back({"scene", "list", at});
  commands.push_back({"scene", "delete", "other", at});
  for (const std::vector<std::string>& command : commands) {
    Interruption interruption;
    interruption.Interrupt();
    std::ostringstream out, err;
    EXPECT_EQ(RunCli(command, out, err, /*err_is_terminal=*/false, &interruption), kExitTemporary)
        << command[0] << ' ' << command[1] << ": " << err.str();
    EXPECT_EQ(out.str(), "");
    EXPECT_THAT(err.str(), HasSubstr(kGivenUp));
  }
  EXPECT_THAT(ScenesAt(absl::StrCat("127.0.0.1:", server->port())), IsEmpty());
  ExpectNoOutput();
}

// An error is told whenever the signal came, if giving up cannot be its cause.
TEST_F(CliInterruptionTest, WhatIsWrongIsToldThoughInterrupted) {
  const std::tuple<std::vector<std::string>, ExitCode, std::string> commands[] = {
      {{"view", obj_, "--size=big"}, kExitUsage, "size"},
      {{"check", File("none.obj")}, kExitNoInput, "none.obj"},
      {{"import", obj_, "-o", File("none/out.slscene")}, kExitCannotCreate, "none"}};
  for (const auto& [command, code, word] : commands) {
    Interruption interruption;
    interruption.Interrupt();
    std::ostringstream out, err;
    EXPECT_EQ(RunCli(command, out, err, /*err_is_terminal=*/false, &interruption), code);
    EXPECT_THAT(err.str(), HasSubstr(word));
    EXPECT_THAT(err.str(), Not(HasSubstr(kGivenUp)));
  }
}

// Interrupts once it is warned of something: the file is read by then, and no scene made of it yet.
class InterruptingStream : public testing_support::WatchedStream {
 public:
  Interruption interruption;
  std::string text;

 private:
  void OnWrite(std::string_view bytes) override {
    text += bytes;
    if (bytes.find("warning") != std::string_view::npos) interruption.Interrupt();
  }
};

TEST_F(CliInterruptionTest, ASceneThatIsOpenedIsGivenUp) {
  const std::string faulty = Write("faulty.obj", absl::StrCat(kSmallObj, "f 1 2 1000\n"));
  const auto server = StartServer();
  for (std::vector<std::string> command : Queries(faulty)) {
    command.push_back(ServerFlag(*server));
    InterruptingStream err;
    std::ostringstream out;
    EXPECT_EQ(RunCli(command, out, err.stream, /*err_is_terminal=*/true, &err.interruption),
              kExitTemporary)
        << err.text;
    EXPECT_THAT(err.text, HasSubstr(kGivenUp));
  }
  EXPECT_THAT(ScenesAt(absl::StrCat("127.0.0.1:", server->port())), IsEmpty());
  ExpectNoOutput();
}

TEST_F(CliInterruptionTest, AFileThatIsGivenUpWhileItIsWrittenIsNotThere) {
  ThreadPool pool(1);
  const auto scene = BuildScene("box", /*revision=*/1, MakeBuiltin({.name = "box"})->objects,
                                std::nullopt, {}, pool);
  ASSERT_TRUE(scene.ok()) << scene.status();
  Interruption interruption;
  double written = 0;
  const absl::Status status =
      SaveSceneFile(**scene, File("out.slscene"), pool, interruption.work(), [&](double share) {
        written = share;
        interruption.Interrupt();
      });
  EXPECT_TRUE(absl::IsCancelled(status)) << status;
  EXPECT_GT(written, 0);
  EXPECT_LT(written, 1);
  ExpectNoOutput();
}

// Whoever writes into the pipe interrupts, and keeps it open until the command has ended.
TEST_F(CliInterruptionTest, APipeThatNobodyWritesToIsGivenUp) {
  const std::string pipe = File("pipe.csv");
  ASSERT_EQ(mkfifo(pipe.c_str(), 0600), 0);
  Interruption interruption;
  absl::Notification ended;
  std::thread writer([&] {
    const int silent = open(pipe.c_str(), O_WRONLY | O_CLOEXEC);
    interruption.Interrupt();
    ended.WaitForNotification();
    close(silent);
  });
  std::ostringstream out, err;
  EXPECT_EQ(RunCli({"shade", obj_, "--points", pipe, "--light=5,5,9", "--out", out_}, out, err,
                   /*err_is_terminal=*/false, &interruption),
            kExitTemporary)
      << err.str();
  ended.Notify();
  writer.join();
  EXPECT_THAT(err.str(), HasSubstr(kGivenUp));
  ExpectNoOutput();
}

class CliSignalTest : public CliInterruptionTest {
 protected:
  // Frames for minutes.
  std::vector<std::string> LongWork() const {
    return {SIGHTLINE_BINARY,  "relight",
            "builtin:box",     "--size=160x90",
            "--by=1,0,0",      "--compare=0",
            "--out",           out_,
            "--frames=100000", absl::StrCat("--server=", server_.address())};
  }

  ServingProcess server_{std::vector<std::string>{}};
};

TEST_F(CliSignalTest, ATemporarySceneGoesWithWhoMadeIt) {
  for (const int signal : {SIGINT, SIGTERM, SIGHUP}) {
    TerminalProcess work(LongWork());
    ASSERT_TRUE(work.Says("relighting"));
    EXPECT_EQ(ScenesAt(server_.address()).size(), 1u);
    work.Signal(signal);
    EXPECT_EQ(work.Wait(), kExitTemporary) << work.said();
    EXPECT_THAT(work.said(), HasSubstr(kGivenUp));
    EXPECT_EQ(work.out(), "");
    EXPECT_THAT(ScenesAt(server_.address()), IsEmpty());
  }
  ExpectNoOutput();
}

TEST_F(CliSignalTest, ASecondSignalEndsItThereAndThen) {
  for (const int first : {SIGINT, SIGTERM, SIGHUP}) {
    for (const int second : {SIGINT, SIGTERM}) {
      TerminalProcess work(LongWork());
      ASSERT_TRUE(work.Says("relighting"));
      // So that the scene is not deleted meanwhile.
      server_.Signal(SIGSTOP);
      work.Signal(first);
      const bool heard = static_cast<bool>(work.Says("interrupted: once more"));
      work.Signal(second);
      const int code = work.Wait();
      server_.Signal(SIGCONT);
      EXPECT_TRUE(heard);
      EXPECT_EQ(code, 1000 + second) << work.said();
    }
  }
}

// Of a terminal that hangs up, the kernel tells, and the shell that ran in it once more.
TEST_F(CliSignalTest, ASecondHangUpIsTheFirst) {
  for (const int first : {SIGTERM, SIGHUP}) {
    TerminalProcess work(LongWork());
    ASSERT_TRUE(work.Says("relighting"));
    server_.Signal(SIGSTOP);
    work.Signal(first);
    const bool heard = static_cast<bool>(work.Says("interrupted: once more"));
    work.Signal(SIGHUP);
    server_.Signal(SIGCONT);
    EXPECT_TRUE(heard);
    EXPECT_EQ(work.Wait(), kExitTemporary) << work.said();
    EXPECT_THAT(ScenesAt(server_.address()), IsEmpty());
  }
}

// As nohup has SIGHUP, and a script SIGINT of what it starts in the background.
TEST_F(CliSignalTest, ASignalThatIsIgnoredStaysSo) {
  for (const int ignored : {SIGINT, SIGTERM, SIGHUP}) {
    const int other = ignored == SIGINT ? SIGTERM : SIGINT;
    const auto before = std::signal(ignored, SIG_IGN);
    TerminalProcess work(LongWork());
    std::signal(ignored, before);
    ASSERT_TRUE(work.Says("relighting"));
    work.Signal(ignored);
    // Were that the second signal, it would end it; as would the one after it, with the scene.
    server_.Signal(SIGSTOP);
    work.Signal(other);
    const bool heard = static_cast<bool>(work.Says("interrupted: once more"));
    work.Signal(ignored);
    server_.Signal(SIGCONT);
    EXPECT_TRUE(heard);
    EXPECT_EQ(work.Wait(), kExitTemporary) << work.said();
    EXPECT_THAT(ScenesAt(server_.address()), IsEmpty());
  }
}

}  // namespace
}  // namespace sightline::cli
