// SPDX-License-Identifier: Apache-2.0
#include "server/options.h"

#include <algorithm>
#include <map>
#include <set>
#include <utility>

#include "absl/status/status.h"
#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_replace.h"
#include "absl/strings/string_view.h"
#include "absl/strings/strip.h"
#include "absl/time/clock.h"
#include "core/base/folder.h"
#include "core/base/status_macros.h"
#include "core/mesh/builtin/builtin.h"
#include "server/auth/access_policy.h"
#include "server/base/resource_name.h"
#include "server/client_part.h"
#include "server/machine_memory.h"
#include "server/net/socket_address.h"

namespace sightline {
namespace {

constexpr int kMaxThreads = 1000;

absl::Status Bad(absl::string_view value, absl::string_view remedy) {
  return absl::InvalidArgumentError(absl::StrCat("\"", value, "\": ", remedy));
}

absl::Status SetThreads(absl::string_view value, int* out) {
  if (absl::SimpleAtoi(value, out) && *out >= 0 && *out <= kMaxThreads) return absl::OkStatus();
  return Bad(value, "must be 0 .. 1000");
}

absl::Status SetDuration(absl::string_view value, absl::Duration* out) {
  if (absl::ParseDuration(value, out) && *out >= absl::ZeroDuration() && *out <= absl::Hours(24)) {
    return absl::OkStatus();
  }
  return Bad(value, "must be a duration of 0s to 24h, such as 30s or 1m30s");
}

// Sets a text within a part of the options.
template <typename Part>
std::function<absl::Status(absl::string_view, ParsedOptions*)> Text(Part ServerOptions::*part,
                                                                    std::string Part::*text) {
  return [part, text](absl::string_view value, ParsedOptions* out) {
    out->options.*part.*text = std::string(value);
    return absl::OkStatus();
  };
}

// A duration, or "none" for an infinite one.
absl::Status SetDurationOrNone(absl::string_view value, absl::Duration* out) {
  if (value != "none") return SetDuration(value, out);
  *out = absl::InfiniteDuration();
  return absl::OkStatus();
}

const MachineMemory& Memory() {
  static const auto* const memory = new MachineMemory(ThisMachinesMemory());
  return *memory;
}

// Where the default of a limit comes from; empty for a constant.
std::string OriginOf(const LimitEntry& entry) {
  if (const ClientPart* part = TotalOf(entry.name); part != nullptr) {
    return absl::StrCat("half of ", absl::StrReplaceAll(part->total_name, {{"_", "-"}}));
  }
  Limits others;
  ShareMemory(1, &others);  // Changes what is a share, to the least that it may be.
  if (Memory().bytes == 0 || others.*entry.value == Limits().*entry.value) return "";
  return absl::StrCat(entry.value == &Limits::max_point_set_bytes ? "an eighth" : "five eighths",
                      " of the memory of ", Memory().origin);
}

std::vector<Option> MakeTable() {
  ServerOptions defaults;
  defaults.limits = DefaultLimits();
  std::vector<Option> table = {
      {"listen", "HOST:PORT|unix:PATH",
       "where to listen; may be given more than once; port 0 takes a free one; only loopback is "
       "safe without TLS",
       defaults.listen.front(),
       [](absl::string_view value, ParsedOptions* out) {
         if (value.empty()) return Bad(value, "must be HOST:PORT or unix:PATH");
         if (!std::exchange(out->listen_given, true)) out->options.listen.clear();
         out->options.listen.emplace_back(value);
         return absl::OkStatus();
       },
       /*repeated=*/true},
      {"unix-socket-mode", "OCTAL", "permissions of Unix sockets, who may connect", "0600",
       [](absl::string_view value, ParsedOptions* out) {
         const bool octal = !value.empty() && value.size() <= 4 &&
                            value.find_first_not_of("01234567") == absl::string_view::npos;
         if (!octal) return Bad(value, "must be an octal mode such as 0660");
         out->options.unix_socket_mode = std::stoi(std::string(value), nullptr, 8) & 0777;
         return absl::OkStatus();
       }},
      {"tls-cert", "FILE", "PEM certificate of this server, then its chain: TLS on TCP", "none",
       Text(&ServerOptions::tls, &TlsFiles::certificate)},
      {"tls-key", "FILE", "PEM private key of --tls-cert", "none",
       Text(&ServerOptions::tls, &TlsFiles::key)},
      {"tls-client-ca", "FILE", "PEM authorities that clients' certificates must come from", "none",
       Text(&ServerOptions::tls, &TlsFiles::client_ca)},
      {"tls-client-auth", "WHEN",
       "with --tls-client-ca: required, or optional for clients that show a token instead",
       "required",
       [](absl::string_view value, ParsedOptions* out) {
         if (value != "required" && value != "optional") {
           return Bad(value, "must be required or optional");
         }
         out->options.client_certificate_optional = value == "optional";
         return absl::OkStatus();
       }},
      {"access-file", "FILE", "who may do what: lines of ROLES and a certificate's name or a token",
       "none",
       [](absl::string_view value, ParsedOptions* out) {
         out->options.access_file = std::string(value);
         return absl::OkStatus();
       }},
      {"reload-interval", "DURATION",
       "how often certificates and the access file are looked at; SIGHUP does it at once",
       absl::FormatDuration(defaults.reload_interval),
       [](absl::string_view value, ParsedOptions* out) {
         SL_RETURN_IF_ERROR(SetDuration(value, &out->options.reload_interval));
         return out->options.reload_interval >= absl::Milliseconds(100)
                    ? absl::OkStatus()
                    : Bad(value, "must be at least 100ms");
       }},
      {"port-file", "FILE", "written with the bound port once it is bound", "none",
       [](absl::string_view value, ParsedOptions* out) {
         out->options.port_file = std::string(value);
         return absl::OkStatus();
       }},
      {"scene", "[ID=]builtin:NAME[:TRIANGLES][,seed=N]",
       "a scene to make before listening, unless the repository has one of its name; may be given "
       "more than once",
       "none",
       [](absl::string_view value, ParsedOptions* out) {
         out->options.scenes.emplace_back(value);
         return absl::OkStatus();
       },
       /*repeated=*/true},
      {"repository", "FOLDER",
       "where scenes are stored, as native files; those in it are loaded before listening", "none",
       [](absl::string_view value, ParsedOptions* out) {
         out->options.repository = std::string(value);
         return absl::OkStatus();
       }},
      {"load", "WHICH", "all: every scene of the repository at the start; none: when asked to",
       "all",
       [](absl::string_view value, ParsedOptions* out) {
         if (value != "all" && value != "none") return Bad(value, "must be all or none");
         out->options.load_repository = value == "all";
         return absl::OkStatus();
       }},
      {"scene-files", "HOW",
       "mapped: a stored scene is its file, mapped; what the disk then fails to deliver ends the "
       "process; read: it is read into memory whole, and such a fault ends the load alone",
       "mapped",
       [](absl::string_view value, ParsedOptions* out) {
         if (value != "mapped" && value != "read") return Bad(value, "must be mapped or read");
         out->options.scene_files = value == "read" ? SceneFiles::kRead : SceneFiles::kMapped;
         return absl::OkStatus();
       }},
      {"evict", "WHICH",
       "lru: stored scenes that nobody uses make room, the least recently used first; none: a "
       "scene beyond the budget is refused",
       "none",
       [](absl::string_view value, ParsedOptions* out) {
         if (value != "lru" && value != "none") return Bad(value, "must be lru or none");
         out->options.evict_least_used = value == "lru";
         return absl::OkStatus();
       }},
      {"threads", "N", "threads that answer queries; 0: one per hardware thread", "0",
       [](absl::string_view value, ParsedOptions* out) {
         return SetThreads(value, &out->options.threads);
       }},
      {"build-threads", "N",
       "threads that build scenes and make point sets; 0: half as many as hardware threads, or one",
       "0",
       [](absl::string_view value, ParsedOptions* out) {
         return SetThreads(value, &out->options.build_threads);
       }},
      {"drain-delay", "DURATION",
       "how long after SIGTERM everything goes on but readiness and health, which turn at once: "
       "for whoever sends clients here to hear of it before any is refused",
       absl::FormatDuration(defaults.drain_delay),
       [](absl::string_view value, ParsedOptions* out) {
         return SetDuration(value, &out->options.drain_delay);
       }},
      {"drain-timeout", "DURATION",
       "how long SIGTERM waits, after the delay, for what is under way, such as 30s",
       absl::FormatDuration(defaults.drain_timeout),
       [](absl::string_view value, ParsedOptions* out) {
         return SetDuration(value, &out->options.drain_timeout);
       }},
      {"connection-idle-timeout", "DURATION",
       "connections without a call for so long are closed, of which clients take no notice; none: "
       "they stay",
       absl::FormatDuration(defaults.connection_idle_timeout),
       [](absl::string_view value, ParsedOptions* out) {
         SL_RETURN_IF_ERROR(SetDurationOrNone(value, &out->options.connection_idle_timeout));
         return out->options.connection_idle_timeout >= absl::Milliseconds(100)
                    ? absl::OkStatus()
                    : Bad(value, "must be at least 100ms, or none");
       }},
      {"metrics-listen", "HOST:PORT",
       "where /metrics, /livez and /readyz are served over HTTP; port 0 takes a free one", "none",
       [](absl::string_view value, ParsedOptions* out) {
         out->options.metrics_listen = std::string(value);
         return absl::OkStatus();
       }},
      {"slow-query-log", "DURATION",
       "items that took at least so long are logged, with what they cost", "none",
       [](absl::string_view value, ParsedOptions* out) {
         return SetDurationOrNone(value, &out->options.slow_query_log);
       }},
      {"log-level", "LEVEL", "debug, info, warning, error or off", "info",
       [](absl::string_view value, ParsedOptions* out) -> absl::Status {
         SL_ASSIGN_OR_RETURN(out->options.log_level, ParseLogLevel(value));
         return absl::OkStatus();
       }},
  };
  for (const LimitEntry& entry : LimitTable()) {
    table.push_back(
        {absl::StrReplaceAll(entry.name, {{"_", "-"}}), "N", absl::StrCat("limit: ", entry.help),
         absl::StrCat(defaults.limits.*entry.value),
         [&entry](absl::string_view value, ParsedOptions* out) {
           uint64_t number;
           if (!absl::SimpleAtoi(value, &number) || number < entry.least || number > entry.most) {
             return Bad(value, absl::StrCat("must be ", entry.least, " .. ", entry.most));
           }
           out->options.limits.*entry.value = number;
           return absl::OkStatus();
         },
         /*repeated=*/false, OriginOf(entry)});
  }
  table.push_back({"config", "FILE",
                   "a YAML file of lines OPTION: VALUE; flags and SIGHTLINE_ variables win over it",
                   "none", [](absl::string_view value, ParsedOptions* out) {
                     out->config = std::string(value);
                     return absl::OkStatus();
                   }});
  table.push_back({"check-config", "", "says whether the options are good, and stops", "",
                   [](absl::string_view, ParsedOptions* out) {
                     out->check_config = true;
                     return absl::OkStatus();
                   }});
  table.push_back({"print-config", "", "prints every option and where its value is from, and stops",
                   "", [](absl::string_view, ParsedOptions* out) {
                     out->print_config = true;
                     return absl::OkStatus();
                   }});
  table.push_back({"help", "", "this text", "", [](absl::string_view, ParsedOptions* out) {
                     out->help = true;
                     return absl::OkStatus();
                   }});
  table.push_back({"version", "", "the version", "", [](absl::string_view, ParsedOptions* out) {
                     out->version = true;
                     return absl::OkStatus();
                   }});
  return table;
}

absl::Status CheckListen(const ServerOptions& options) {
  const auto check = [](absl::string_view name, const std::string& text) {
    const absl::Status status = ParseListenAddress(text).status();
    if (status.ok()) return status;
    return absl::Status(status.code(), absl::StrCat("--", name, " = ", status.message()));
  };
  std::set<std::string> taken;
  // The kernel would say that the port is in use, as if it were by another process.
  const auto take = [&taken](absl::string_view name, const std::string& text) {
    if (absl::EndsWith(text, ":0") || taken.insert(text).second) return absl::OkStatus();
    return absl::InvalidArgumentError(
        absl::StrCat("--", name, " = \"", text, "\": is given twice, and can be bound once"));
  };
  for (const std::string& text : options.listen) {
    SL_RETURN_IF_ERROR(check("listen", text));
    SL_RETURN_IF_ERROR(take("listen", text));
  }
  if (options.metrics_listen.empty()) return absl::OkStatus();
  SL_RETURN_IF_ERROR(check("metrics-listen", options.metrics_listen));
  if (absl::StartsWith(options.metrics_listen, "unix:")) {
    return absl::InvalidArgumentError(absl::StrCat("--metrics-listen = \"", options.metrics_listen,
                                                   "\": must be HOST:PORT, not a Unix socket"));
  }
  return take("metrics-listen", options.metrics_listen);
}

absl::Status CheckSecurity(const ServerOptions& options) {
  const TlsFiles& tls = options.tls;
  if (tls.certificate.empty() != tls.key.empty()) {
    return absl::InvalidArgumentError("--tls-cert and --tls-key come together");
  }
  if (tls.certificate.empty() && !tls.client_ca.empty()) {
    return absl::InvalidArgumentError("--tls-client-ca wants --tls-cert and --tls-key, too");
  }
  if (!tls.certificate.empty()) {
    SL_RETURN_IF_ERROR(ReadTlsBundle(tls, absl::Now()).status());
  }
  if (options.access_file.empty()) return absl::OkStatus();
  return AccessPolicy::Read(options.access_file).status();
}

}  // namespace

Limits DefaultLimits() {
  Limits limits;
  ShareMemory(Memory().bytes, &limits);
  return limits;
}

const std::vector<Option>& OptionTable() {
  static const auto* const table = new std::vector<Option>(MakeTable());
  return *table;
}

absl::StatusOr<SceneOption> ParseSceneOption(absl::string_view text) {
  SceneOption scene;
  const size_t equals = text.find('=');
  // "builtin:hall,seed=7" has an equals sign too, but no id before it.
  const bool named = equals != absl::string_view::npos && equals < text.find(':');
  absl::string_view spec = named ? text.substr(equals + 1) : text;
  scene.spec = std::string(spec);
  if (!absl::ConsumePrefix(&spec, "builtin:")) {
    return absl::InvalidArgumentError(
        absl::StrCat("--scene = \"", text, "\": must be [ID=]builtin:NAME[:TRIANGLES][,seed=N]"));
  }
  if (const absl::Status builtin = ParseBuiltin(std::string(spec)).status(); !builtin.ok()) {
    return absl::InvalidArgumentError(
        absl::StrCat("--scene = \"", text, "\": ", builtin.message()));
  }
  // Without an id: the built-in's own name.
  scene.id = std::string(named ? text.substr(0, equals) : spec.substr(0, spec.find_first_of(":,")));
  SL_RETURN_IF_ERROR(CheckId("--scene", scene.id));
  return scene;
}

std::vector<std::string> StoredInstead(const ServerOptions& options) {
  std::vector<std::string> warnings;
  if (options.repository.empty()) return warnings;
  const absl::StatusOr<Folder> folder = Folder::Open(options.repository, *options.files);
  for (const std::string& text : options.scenes) {
    const absl::StatusOr<SceneOption> scene = ParseSceneOption(text);
    if (!folder.ok() || !scene.ok()) continue;
    const std::string file = absl::StrCat(scene->id, kSceneFileEnding);
    if (!folder->Stamp(file).ok()) continue;
    warnings.push_back(absl::StrCat("--scene = ", text, " is left out: the repository has ", file,
                                    ", which stays"));
  }
  return warnings;
}

absl::Status CheckOptions(const ServerOptions& options) {
  SL_RETURN_IF_ERROR(ValidateLimits(options.limits));
  std::map<std::string, std::string> scenes;  // Options by their ids.
  for (const std::string& text : options.scenes) {
    SL_ASSIGN_OR_RETURN(const SceneOption scene, ParseSceneOption(text));
    const auto [first, inserted] = scenes.emplace(scene.id, text);
    if (inserted) continue;
    return absl::InvalidArgumentError(
        absl::StrCat("--scene = \"", text, "\": the name ", scene.id, " is that of --scene = \"",
                     first->second, "\", too; write ID=builtin:... to give it another"));
  }
  if (!options.repository.empty()) {
    const absl::Status folder = Folder::Open(options.repository, *options.files).status();
    if (!folder.ok()) {
      return absl::InvalidArgumentError(absl::StrCat("--repository = ", folder.message()));
    }
  }
  SL_RETURN_IF_ERROR(CheckListen(options));
  return CheckSecurity(options);
}

std::vector<std::string> WithoutEffect(const ParsedOptions& parsed) {
  const ServerOptions& options = parsed.options;
  std::vector<std::string> warnings;
  const auto check = [&](absl::string_view name, bool has_effect, absl::string_view wants) {
    const auto given = parsed.given.find(name);
    if (given == parsed.given.end() || has_effect) return;
    warnings.push_back(absl::StrCat(given->second.origin, " = ", given->second.values.back(),
                                    " has no effect without ", wants));
  };
  const bool unix_socket =
      std::any_of(options.listen.begin(), options.listen.end(),
                  [](const std::string& text) { return absl::StartsWith(text, "unix:"); });
  check("load", !options.repository.empty(), "--repository");
  check("scene-files", !options.repository.empty(), "--repository");
  check("evict", !options.repository.empty() || !options.evict_least_used, "--repository");
  check("tls-client-auth", !options.tls.client_ca.empty(), "--tls-client-ca");
  check("unix-socket-mode", unix_socket, "--listen unix:PATH");
  return warnings;
}

std::vector<std::string> ForeseenTroubles(const ServerOptions& options) {
  std::vector<std::string> warnings;
  if (options.repository.empty()) return warnings;
  const absl::StatusOr<Folder> folder = Folder::Open(options.repository, *options.files);
  if (!folder.ok()) return warnings;  // CheckOptions says so.
  if (const absl::Status writable = folder->CheckWritable(); !writable.ok()) {
    warnings.push_back(absl::StrCat("--repository: ", writable.message(),
                                    ": scenes that are made or changed will not be stored"));
  }
  return warnings;
}

std::string HelpText() {
  std::string text =
      "sightlined: answers visibility queries over gRPC.\n\n"
      "  sightlined [--listen HOST:PORT] [--scene builtin:hall:1000000] [FLAGS]\n\n"
      "Runs until SIGTERM or SIGINT, then finishes what is under way; a second one ends it at "
      "once.\n"
      "Exit codes: 0 done, 64 wrong options or files that they name, 69 the server could not start,"
      "\n70 the drain ran out of time, 78 this processor cannot run it.\n\n"
      "An option is taken from its flag, else from the environment (--max-scenes is\n"
      "SIGHTLINE_MAX_SCENES; several values are separated by blanks), else from the file of\n"
      "--config (max-scenes: 10; several values are a list), else it has its default.\n\n"
      "Flags:\n";
  for (const Option& option : OptionTable()) {
    absl::StrAppend(&text, "  --", option.name, option.takes.empty() ? "" : " ", option.takes,
                    "\n");
    absl::StrAppend(&text, "      ", option.help);
    if (!option.takes.empty()) {
      absl::StrAppend(&text, " (default: ", option.default_text,
                      option.default_origin.empty() ? "" : ", ", option.default_origin, ")");
    }
    absl::StrAppend(&text, "\n");
  }
  return text;
}

}  // namespace sightline
