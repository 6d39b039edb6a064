// SPDX-License-Identifier: Apache-2.0
//
// sightlined as a process that serves: started with flags and limits, reached by channels, watched
// for what it takes.
//
// Thread safety: one thread, except that Channel may be called from any.
//
//   ServingProcess server({"--scene=builtin:room:5000"}, {.limits = {{RLIMIT_NOFILE, 64}}});
//   auto channel = server.Channel();
//   server.Signal(SIGTERM);
//   EXPECT_EQ(server.Wait(), 0);
#ifndef SIGHTLINE_TESTS_INTEGRATION_SERVING_PROCESS_H_
#define SIGHTLINE_TESTS_INTEGRATION_SERVING_PROCESS_H_

#include <grpcpp/grpcpp.h>
#include <sys/resource.h>
#include <time.h>  // NOLINT(modernize-deprecated-headers): the CPU clocks are POSIX.
#include <unistd.h>

#include <csignal>
#include <cstdint>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <map>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "gtest/gtest.h"
#include "tests/integration/server_process.h"

namespace sightline {

class ServingProcess : public ServerProcess {
 public:
  struct Options {
    std::vector<std::pair<int, rlim_t>> limits;  // setrlimit's resource and value.
    std::string listen = "127.0.0.1:0";
    std::vector<std::pair<std::string, std::string>> environment;  // Beside what this process has.
  };

  explicit ServingProcess(const std::vector<std::string>& flags)
      : ServingProcess(flags, Options()) {}
  ServingProcess(std::vector<std::string> flags, const Options& options)
      : ServerProcess(WithListen(std::move(flags), options.listen),
                      [&options] {
                        for (const auto& [name, value] : options.environment) {
                          setenv(name.c_str(), value.c_str(), 1);
                        }
                        for (const auto& [resource, value] : options.limits) {
                          const rlimit limit{value, value};
                          if (setrlimit(static_cast<__rlimit_resource_t>(resource), &limit) != 0) {
                            _exit(126);
                          }
                        }
                      }),
        port_(Port()) {
    if (port_ == 0) std::abort();  // Reported; whatever follows would wait for it.
  }

  std::string address() const { return absl::StrCat("127.0.0.1:", port_); }
  int port() const { return port_; }
  // A connection of its own, which tries again soon after it was lost.
  std::shared_ptr<grpc::Channel> Channel() const { return ChannelTo(address()); }
  static std::shared_ptr<grpc::Channel> ChannelTo(const std::string& address) {
    grpc::ChannelArguments arguments;
    arguments.SetMaxReceiveMessageSize(-1);
    arguments.SetInt(GRPC_ARG_USE_LOCAL_SUBCHANNEL_POOL, 1);
    arguments.SetInt(GRPC_ARG_INITIAL_RECONNECT_BACKOFF_MS, 20);
    arguments.SetInt(GRPC_ARG_MAX_RECONNECT_BACKOFF_MS, 200);
    return grpc::CreateCustomChannel(address, grpc::InsecureChannelCredentials(), arguments);
  }

  // As the kernel counts them: in memory, and of addresses, which RLIMIT_AS bounds.
  uint64_t ResidentBytes() const { return MemoryNow().resident; }
  uint64_t AddressBytes() const { return MemoryNow().addresses; }
  // The most that has ever been resident.
  uint64_t PeakResidentBytes() const {
    std::ifstream file(absl::StrCat("/proc/", pid(), "/status"));
    uint64_t kibibytes = 0;
    for (std::string word; file >> word;) {
      if (word == "VmHWM:") file >> kibibytes;
    }
    EXPECT_GT(kibibytes, 0u);
    return kibibytes << 10;
  }
  uint64_t OpenDescriptors() const {
    const std::filesystem::directory_iterator all(absl::StrCat("/proc/", pid(), "/fd"));
    return static_cast<uint64_t>(std::distance(begin(all), end(all)));
  }
  // What the process may take from now on.
  void Limit(int resource, rlim_t value) const {
    const rlimit limit{value, value};
    EXPECT_EQ(prlimit(pid(), static_cast<__rlimit_resource>(resource), &limit, nullptr), 0);
  }
  // To the nanosecond, of all its threads; /proc counts in ticks of ten milliseconds.
  double CpuSeconds() const {
    clockid_t clock = 0;
    timespec time{};
    EXPECT_EQ(clock_getcpuclockid(pid(), &clock), 0);
    EXPECT_EQ(clock_gettime(clock, &time), 0);
    return static_cast<double>(time.tv_sec) + 1e-9 * static_cast<double>(time.tv_nsec);
  }

  // How long each of its threads was ready to run and had no core, so far, by its id; nothing where
  // the kernel does not say.
  std::map<std::string, double> WaitedForCoreSeconds() const {
    std::map<std::string, double> waited;
    for (const auto& task :
         std::filesystem::directory_iterator(absl::StrCat("/proc/", pid(), "/task"))) {
      std::ifstream file(task.path() / "schedstat");
      uint64_t run_nanos = 0, wait_nanos = 0;
      if (file >> run_nanos >> wait_nanos) {
        waited[task.path().filename()] = 1e-9 * static_cast<double>(wait_nanos);
      }
    }
    return waited;
  }

 private:
  struct Memory {
    uint64_t addresses = 0, resident = 0;
  };
  Memory MemoryNow() const {
    std::ifstream file(absl::StrCat("/proc/", pid(), "/statm"));
    Memory memory;
    file >> memory.addresses >> memory.resident;
    const auto page = static_cast<uint64_t>(sysconf(_SC_PAGESIZE));
    return {memory.addresses * page, memory.resident * page};
  }
  static std::vector<std::string> WithListen(std::vector<std::string> flags,
                                             const std::string& listen) {
    flags.push_back(absl::StrCat("--listen=", listen));
    return flags;
  }

  const int port_;
};

}  // namespace sightline

#endif  // SIGHTLINE_TESTS_INTEGRATION_SERVING_PROCESS_H_
