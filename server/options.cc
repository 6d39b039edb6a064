// SPDX-License-Identifier: Apache-2.0
#include "server/options.h"

#include <functional>
#include <utility>

#include "absl/status/status.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_replace.h"
#include "absl/strings/string_view.h"
#include "absl/strings/strip.h"
#include "core/base/status_macros.h"

namespace sightline {
namespace {

constexpr int kMaxThreads = 1000;

struct Option {
  std::string name;   // With dashes.
  std::string takes;  // What stands for the value in --help; empty for a switch.
  std::string help;
  std::string default_text;
  std::function<absl::Status(absl::string_view, ParsedOptions*)> set;
};

absl::Status Bad(absl::string_view value, absl::string_view remedy) {
  return absl::InvalidArgumentError(absl::StrCat("\"", value, "\": ", remedy));
}

absl::Status SetThreads(absl::string_view value, int* out) {
  if (absl::SimpleAtoi(value, out) && *out >= 0 && *out <= kMaxThreads) return absl::OkStatus();
  return Bad(value, "must be 0 .. 1000");
}

std::vector<Option> MakeTable() {
  const ServerOptions defaults;
  std::vector<Option> table = {
      {"listen", "HOST:PORT",
       "where to listen; port 0 takes a free one; only loopback is safe without TLS",
       defaults.listen,
       [](absl::string_view value, ParsedOptions* out) {
         if (value.empty()) return Bad(value, "must be HOST:PORT");
         out->options.listen = std::string(value);
         return absl::OkStatus();
       }},
      {"port-file", "FILE", "written with the bound port once it is bound", "none",
       [](absl::string_view value, ParsedOptions* out) {
         out->options.port_file = std::string(value);
         return absl::OkStatus();
       }},
      {"scene", "[ID=]builtin:NAME[:TRIANGLES]",
       "a scene to make before listening; may be given more than once", "none",
       [](absl::string_view value, ParsedOptions* out) {
         out->options.scenes.emplace_back(value);
         return absl::OkStatus();
       }},
      {"threads", "N", "threads that answer queries; 0: one per hardware thread", "0",
       [](absl::string_view value, ParsedOptions* out) {
         return SetThreads(value, &out->options.threads);
       }},
      {"build-threads", "N", "threads that build scenes; 0: one per hardware thread", "0",
       [](absl::string_view value, ParsedOptions* out) {
         return SetThreads(value, &out->options.build_threads);
       }},
      {"drain-timeout", "DURATION", "how long SIGTERM waits for what is under way, such as 30s",
       absl::FormatDuration(defaults.drain_timeout),
       [](absl::string_view value, ParsedOptions* out) {
         absl::Duration* timeout = &out->options.drain_timeout;
         if (absl::ParseDuration(value, timeout) && *timeout >= absl::ZeroDuration() &&
             *timeout <= absl::Hours(24)) {
           return absl::OkStatus();
         }
         return Bad(value, "must be a duration of 0s to 24h, such as 30s or 1m30s");
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
         }});
  }
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

const std::vector<Option>& Table() {
  static const auto* const table = new std::vector<Option>(MakeTable());
  return *table;
}

const Option* Find(const std::string& name) {
  for (const Option& option : Table()) {
    if (option.name == name) return &option;
  }
  return nullptr;
}

}  // namespace

absl::StatusOr<ParsedOptions> ParseFlags(int argc, const char* const* argv) {
  ParsedOptions parsed;
  for (int i = 1; i < argc; ++i) {
    absl::string_view argument = argv[i];
    if (!absl::ConsumePrefix(&argument, "--")) {
      return absl::InvalidArgumentError(
          absl::StrCat("\"", argv[i], "\" is no flag; --help lists them"));
    }
    const size_t equals = argument.find('=');
    const std::string name = absl::StrReplaceAll(argument.substr(0, equals), {{"_", "-"}});
    const Option* option = Find(name);
    if (option == nullptr) {
      return absl::InvalidArgumentError(
          absl::StrCat("there is no flag --", name, "; --help lists them"));
    }
    absl::string_view value;
    if (equals != absl::string_view::npos) {
      value = argument.substr(equals + 1);
    } else if (!option->takes.empty()) {
      if (++i == argc) {
        return absl::InvalidArgumentError(absl::StrCat("--", name, " needs ", option->takes));
      }
      value = argv[i];
    }
    if (option->takes.empty() && equals != absl::string_view::npos) {
      return absl::InvalidArgumentError(absl::StrCat("--", name, " takes no value"));
    }
    if (absl::Status status = option->set(value, &parsed); !status.ok()) {
      return absl::InvalidArgumentError(absl::StrCat("--", name, " = ", status.message()));
    }
  }
  return parsed;
}

std::string HelpText() {
  std::string text =
      "sightlined: answers visibility queries over gRPC.\n\n"
      "  sightlined [--listen HOST:PORT] [--scene builtin:hall:1000000] [FLAGS]\n\n"
      "Runs until SIGTERM or SIGINT, then finishes what is under way.\n"
      "Exit codes: 0 done, 64 wrong flags, 69 the server could not start, 70 the drain ran out of "
      "time.\n\n"
      "Flags:\n";
  for (const Option& option : Table()) {
    absl::StrAppend(&text, "  --", option.name, option.takes.empty() ? "" : " ", option.takes,
                    "\n");
    absl::StrAppend(&text, "      ", option.help);
    if (!option.takes.empty()) absl::StrAppend(&text, " (default: ", option.default_text, ")");
    absl::StrAppend(&text, "\n");
  }
  return text;
}

}  // namespace sightline
