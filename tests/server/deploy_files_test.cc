// SPDX-License-Identifier: Apache-2.0
//
// What deploy/ says of the server is true of it: every option, metric, path and time that its files
// name is one that the server has.
#include <algorithm>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <map>
#include <regex>
#include <set>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"
#include "absl/time/time.h"
#include "gtest/gtest-spi.h"
#include "gtest/gtest.h"
#include "server/config_file.h"
#include "server/metrics/metrics.h"
#include "server/options.h"
#include "yaml-cpp/yaml.h"

namespace sightline {
namespace {

const std::string kRoot = absl::StrCat(SIGHTLINE_SOURCE_DIR, "/");

std::string Read(const std::string& path) {
  std::ifstream in(kRoot + path, std::ios::binary);
  EXPECT_TRUE(in.good()) << path;
  return {std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>()};
}

std::vector<std::string> Found(const std::string& text, const std::string& pattern, int group = 0) {
  const std::regex regex(pattern);
  std::vector<std::string> found;
  for (std::sregex_iterator match(text.begin(), text.end(), regex), end; match != end; ++match) {
    found.push_back((*match)[static_cast<size_t>(group)]);
  }
  return found;
}

std::set<std::string> OptionNames() {
  std::set<std::string> names;
  for (const Option& option : OptionTable()) names.emplace(option.name);
  return names;
}

// The documents of the Kubernetes manifest, by kind.
YAML::Node Manifest(const std::string& kind) {
  for (const YAML::Node& document : YAML::LoadAll(Read("deploy/kubernetes/sightline.yaml"))) {
    if (document["kind"].as<std::string>() == kind) return document;
  }
  ADD_FAILURE() << "no " << kind;
  return {};
}

struct NamedConfig {
  std::string name, text;
};
std::vector<NamedConfig> Configs() {
  return {{"deploy/systemd/sightlined.yaml", Read("deploy/systemd/sightlined.yaml")},
          {"deploy/container/sightlined.yaml", Read("deploy/container/sightlined.yaml")},
          {"deploy/kubernetes/sightline.yaml",
           Manifest("ConfigMap")["data"]["sightlined.yaml"].as<std::string>()}};
}

// How long it may take from SIGTERM to the end, what is cut off at last included.
absl::Duration DrainTime(const NamedConfig& config) {
  absl::Duration delay = ServerOptions().drain_delay, drain = absl::InfiniteDuration();
  const auto entries = ParseConfig(config.name, config.text);
  EXPECT_TRUE(entries.ok()) << entries.status();
  for (const ConfigEntry& entry : *entries) {
    if (entry.key == "drain-delay") {
      EXPECT_TRUE(absl::ParseDuration(entry.values.at(0), &delay));
    }
    if (entry.key == "drain-timeout") {
      EXPECT_TRUE(absl::ParseDuration(entry.values.at(0), &drain));
    }
  }
  return delay + drain + kCutOffTimeout;
}

TEST(DeployFilesTest, ConfigurationsNameOptions) {
  const std::set<std::string> names = OptionNames();
  for (const NamedConfig& config : Configs()) {
    const auto entries = ParseConfig(config.name, config.text);
    ASSERT_TRUE(entries.ok()) << entries.status();
    EXPECT_FALSE(entries->empty()) << config.name;
    for (const ConfigEntry& entry : *entries) {
      const auto option = std::find_if(OptionTable().begin(), OptionTable().end(),
                                       [&](const Option& each) { return each.name == entry.key; });
      ASSERT_NE(option, OptionTable().end()) << config.name << " names " << entry.key;
      ParsedOptions parsed;
      for (const std::string& value : entry.values) {
        const absl::Status set = option->set(value, &parsed);
        EXPECT_TRUE(set.ok()) << config.name << ": " << entry.key << ": " << set;
      }
    }
    // Those that are there to be made lines of.
    for (const std::string& key : Found(config.text, "\n# ([a-z][a-z-]+): \\S", 1)) {
      EXPECT_TRUE(names.contains(key)) << config.name << " names " << key;
    }
  }
}

TEST(DeployFilesTest, FlagsAndVariablesAreTheServers) {
  const std::set<std::string> names = OptionNames();
  const std::string unit = Read("deploy/systemd/sightlined.service");
  const std::string container = Read("deploy/container/Containerfile");
  const std::string entry = container.substr(container.find("ENTRYPOINT"));
  std::vector<std::string> flags = Found(unit, "sightlined (--[^\n]*)", 1);
  flags.push_back(entry);
  for (const YAML::Node& argument :
       Manifest("StatefulSet")["spec"]["template"]["spec"]["containers"][0]["args"]) {
    flags.push_back(argument.as<std::string>());
  }
  size_t seen = 0;
  for (const std::string& words : flags) {
    for (const std::string& flag : Found(words, "--([a-z-]+)", 1)) {
      EXPECT_TRUE(names.contains(flag)) << flag;
      ++seen;
    }
  }
  EXPECT_GE(seen, 3u);
  for (const std::string& text : {unit, container}) {
    for (std::string name : Found(text, "SIGHTLINE_([A-Z_]+)=", 1)) {
      std::transform(name.begin(), name.end(), name.begin(),
                     [](char c) { return c == '_' ? '-' : static_cast<char>(c - 'A' + 'a'); });
      EXPECT_TRUE(names.contains(name)) << name;
    }
  }
}

// A metric's labels, and the values that each has in some sample.
using Labels = std::map<std::string, std::set<std::string>>;

// Every metric that a server has, with those that its scraping adds.
std::map<std::string, Labels> MetricsOfAServer() {
  ServerState state;
  state.scenes.push_back({.id = "hall"});
  state.certificate_end = absl::UnixEpoch() + absl::Hours(1);
  Metrics metrics([&] { return state; });
  std::map<std::string, Labels> all;
  for (const std::string& line : Found(metrics.Text(), "\n[a-z_]+(\\{[^\n]*\\})? ")) {
    Labels& labels = all[Found(line, "[a-z_]+").front()];
    for (const std::string& label : Found(line, "[a-z_]+=\"[^\"]*\"")) {
      const std::vector<std::string> parts = absl::StrSplit(label, absl::MaxSplits('=', 1));
      labels[parts[0]].insert(parts[1].substr(1, parts[1].size() - 2));
    }
  }
  all["up"];
  for (auto& [name, labels] : all) {
    labels["instance"];
    labels["job"];
  }
  return all;
}

// Whether what an expression asks for is there: its metrics have the labels that it selects by,
// with the values that it names, and those that it groups by or that `legend` names. Returns how
// many metrics it names.
size_t ExpectMetrics(const std::string& expression, const std::string& legend) {
  static const auto* const kAll = new std::map<std::string, Labels>(MetricsOfAServer());
  std::set<std::string> common;  // The labels that all of its metrics have.
  size_t asked = 0;
  for (const std::string& selector :
       Found(expression, "\\b(?:(?:sightline|process)_[a-z_]+|up\\b)(?:\\{[^}]*\\})?")) {
    const auto metric = kAll->find(Found(selector, "[a-z_]+").front());
    if (metric == kAll->end()) {
      ADD_FAILURE() << selector << " of " << expression;
      continue;
    }
    std::set<std::string> labels;
    for (const auto& [label, values] : metric->second) labels.insert(label);
    for (const std::string& matcher : Found(selector, "[a-z_]+(=~|!=|!~|=)\"[^\"]*\"")) {
      const std::string label = Found(matcher, "[a-z_]+").front();
      const std::string value = Found(matcher, "\"(.*)\"", 1).front();
      EXPECT_TRUE(labels.contains(label)) << label << " of " << selector;
      if (label == "instance" || label == "job" || matcher[label.size() + 1] == '~') continue;
      const auto values = metric->second.find(label);
      EXPECT_TRUE(values == metric->second.end() || values->second.contains(value))
          << value << " of " << selector;
    }
    std::set<std::string> both;
    std::set_intersection(labels.begin(), labels.end(), common.begin(), common.end(),
                          std::inserter(both, both.begin()));
    common = asked++ == 0 ? labels : both;
  }
  std::set<std::string> kept = common;  // By what comes out of it.
  for (const std::string& by : Found(expression, "(?:sum|max|min|avg) (?:by \\(([^)]*)\\))?", 1)) {
    kept.clear();
    for (const std::string& label : Found(by, "[a-z_]+")) {
      EXPECT_TRUE(common.contains(label)) << label << " of " << expression;
      if (label != "le") kept.insert(label);  // histogram_quantile takes it.
    }
  }
  for (const std::string& label : Found(legend, "\\{\\{ ?(?:\\$labels\\.)?([a-z_]+) ?\\}\\}", 1)) {
    EXPECT_TRUE(kept.contains(label)) << legend << " of " << expression;
  }
  return asked;
}

TEST(DeployFilesTest, DashboardsAskForMetricsThatThereAre) {
  const YAML::Node dashboard = YAML::Load(Read("deploy/grafana/sightline.json"));  // JSON is YAML.
  size_t asked = 0;
  for (const YAML::Node& panel : dashboard["panels"]) {
    SCOPED_TRACE(panel["title"].as<std::string>());
    for (const YAML::Node& target : panel["targets"]) {
      asked +=
          ExpectMetrics(target["expr"].as<std::string>(), target["legendFormat"].as<std::string>());
    }
  }
  EXPECT_GT(asked, 30u);
  for (const YAML::Node& variable : dashboard["templating"]["list"]) {
    for (const std::string& name :
         Found(variable["query"].as<std::string>(), "label_values\\(([a-z_]+),", 1)) {
      EXPECT_EQ(ExpectMetrics(name, absl::StrCat("{{", variable["name"].as<std::string>(), "}}")),
                1u);
    }
  }
}

TEST(DeployFilesTest, AlertsAskForMetricsThatThereAre) {
  const YAML::Node groups = YAML::Load(Read("deploy/prometheus/sightline.rules.yaml"))["groups"];
  std::set<std::string> alerts, of;
  for (const YAML::Node& group : groups) {
    for (const YAML::Node& rule : group["rules"]) {
      const std::string name = rule["alert"].as<std::string>();
      SCOPED_TRACE(name);
      EXPECT_TRUE(alerts.insert(name).second);
      const std::string expression = rule["expr"].as<std::string>();
      EXPECT_GT(ExpectMetrics(expression, rule["annotations"]["summary"].as<std::string>()), 0u);
      EXPECT_EQ(Found(expression, "\\(").size(), Found(expression, "\\)").size());
      if (rule["for"].IsDefined()) {
        absl::Duration time;
        EXPECT_TRUE(absl::ParseDuration(rule["for"].as<std::string>(), &time));
      }
      EXPECT_FALSE(Found(rule["labels"]["severity"].as<std::string>(), "^(page|ticket)$").empty());
      for (const std::string& metric : Found(expression, "sightline_[a-z_]+")) of.insert(metric);
    }
  }
  // What an operator wants to hear of.
  for (const char* metric :
       {"sightline_requests_total", "sightline_pending_rays", "sightline_scene_memory_bytes",
        "sightline_unstored_scenes", "sightline_draining", "sightline_certificate_end_seconds"}) {
    EXPECT_TRUE(of.contains(metric)) << metric;
  }
}

// What the two tests above find, planted.
TEST(DeployFilesTest, PlantedMetricsAreFound) {
  const auto planted = [](const char* expression, const char* legend = "") {
    testing::TestPartResultArray failures;
    {
      testing::ScopedFakeTestPartResultReporter report(
          testing::ScopedFakeTestPartResultReporter::INTERCEPT_ONLY_CURRENT_THREAD, &failures);
      ExpectMetrics(expression, legend);
    }
    return failures.size();
  };
  EXPECT_EQ(planted("sum by (result) (rate(sightline_requests_total[5m]))", "{{result}}"), 0);
  EXPECT_EQ(planted("rate(sightline_request_total[5m])"), 1);
  EXPECT_EQ(planted("sightline_requests_total{results=\"ok\"}"), 1);
  EXPECT_EQ(planted("sightline_requests_total{result!=\"okay\"}"), 1);
  EXPECT_EQ(planted("sum by (outcome) (rate(sightline_requests_total[5m]))"), 1);
  EXPECT_EQ(planted("sum by (method) (rate(sightline_requests_total[5m]))", "{{result}}"), 1);
  EXPECT_EQ(planted("sum (rate(sightline_requests_total[5m]))", "{{method}}"), 1);
  EXPECT_EQ(planted("sightline_draining", "{{ $labels.scene }}"), 1);
  EXPECT_EQ(planted("sightline_scene_bytes", "{{scene}} of {{instance}}"), 0);
}

TEST(DeployFilesTest, ProbesAskForPathsThatThereAre) {
  const std::string server = Read("server/server.cc");
  const YAML::Node container = Manifest("StatefulSet")["spec"]["template"]["spec"]["containers"][0];
  for (const char* probe : {"startupProbe", "readinessProbe", "livenessProbe"}) {
    const std::string path = container[probe]["httpGet"]["path"].as<std::string>();
    EXPECT_NE(server.find(absl::StrCat("{\"", path, "\"")), std::string::npos) << path;
  }
  for (const std::string& path :
       Found(Read("deploy/container/Containerfile"), "GET (/[a-z]+)", 1)) {
    EXPECT_NE(server.find(absl::StrCat("{\"", path, "\"")), std::string::npos) << path;
  }
}

TEST(DeployFilesTest, TheUnitDoesNotRestartWhatStaysWrong) {
  const std::string unit = Read("deploy/systemd/sightlined.service");
  // It looks at the main process alone, so that nothing may fail before that.
  EXPECT_TRUE(Found(unit, "\nExecStartPre=").empty());
  EXPECT_EQ(Found(unit, "\nRestartPreventExitStatus=([^\n]*)", 1),
            std::vector<std::string>{"64 78"});
}

// Whoever stops the server waits longer than it may take to drain.
TEST(DeployFilesTest, StopsWaitForTheDrain) {
  const std::vector<NamedConfig> configs = Configs();
  const std::vector<std::string> unit =
      Found(Read("deploy/systemd/sightlined.service"), "TimeoutStopSec=([0-9]+)", 1);
  ASSERT_EQ(unit.size(), 1u);
  EXPECT_GT(absl::Seconds(std::stoi(unit[0])), DrainTime(configs[0]));
  const std::vector<std::string> container =
      Found(Read("deploy/container/Containerfile"), "stop --time ([0-9]+)", 1);
  ASSERT_EQ(container.size(), 1u);
  EXPECT_GT(absl::Seconds(std::stoi(container[0])), DrainTime(configs[1]));
  const YAML::Node pod = Manifest("StatefulSet")["spec"]["template"]["spec"];
  EXPECT_GT(absl::Seconds(pod["terminationGracePeriodSeconds"].as<int>()), DrainTime(configs[2]));
  // Where a name stands for all pods, whoever looks it up hears of an end later than the pod does.
  EXPECT_NE(configs[2].text.find("drain-delay: "), std::string::npos);
}

// Every volume that is mounted is one of the pod's, and nothing may be written but on volumes.
TEST(DeployFilesTest, ThePodsRightsAreFew) {
  const YAML::Node set = Manifest("StatefulSet")["spec"];
  const YAML::Node pod = set["template"]["spec"];
  std::set<std::string> volumes;
  for (const YAML::Node& volume : pod["volumes"]) volumes.insert(volume["name"].as<std::string>());
  for (const YAML::Node& claim : set["volumeClaimTemplates"]) {
    volumes.insert(claim["metadata"]["name"].as<std::string>());
  }
  // A secret's mode is one that the server accepts, and one that its group can read.
  for (const YAML::Node& volume : pod["volumes"]) {
    if (!volume["secret"].IsDefined()) continue;
    EXPECT_EQ(volume["secret"]["defaultMode"].as<std::string>(), "0440") << volume["name"];
  }
  EXPECT_TRUE(pod["securityContext"]["fsGroup"].IsDefined());
  EXPECT_TRUE(pod["securityContext"]["runAsNonRoot"].as<bool>());
  for (const char* kind : {"initContainers", "containers"}) {
    for (const YAML::Node& container : pod[kind]) {
      EXPECT_TRUE(container["securityContext"]["readOnlyRootFilesystem"].as<bool>());
      EXPECT_FALSE(container["securityContext"]["allowPrivilegeEscalation"].as<bool>());
      EXPECT_TRUE(container["resources"]["limits"]["memory"].IsDefined());
      for (const YAML::Node& mount : container["volumeMounts"]) {
        EXPECT_TRUE(volumes.contains(mount["name"].as<std::string>()));
      }
    }
  }
}

TEST(DeployFilesTest, TheContainerIsMadeOfWhatThereIs) {
  const std::string container = Read("deploy/container/Containerfile");
  for (const std::string& line : Found(container, "\nCOPY ([^\n]*)", 1)) {
    if (line.rfind("--from=", 0) == 0) continue;
    std::vector<std::string> words = absl::StrSplit(line, ' ');
    words.pop_back();  // Where they go.
    for (const std::string& word : words) {
      EXPECT_TRUE(std::filesystem::exists(kRoot + word)) << word;
    }
  }
  const std::string packages = Read("deploy/packages.txt");
  for (const std::string& name : Found(container, "RUN \\S*install_packages.sh ([a-z]+)", 1)) {
    EXPECT_FALSE(Found(packages, absl::StrCat("\n", name, " +\\S")).empty()) << name;
  }
  for (const std::string& preset : Found(container, "--preset ([a-z]+)", 1)) {
    EXPECT_FALSE(
        Found(Read("CMakePresets.json"), absl::StrCat("\"name\": \"", preset, "\"")).empty())
        << preset;
  }
}

}  // namespace
}  // namespace sightline
