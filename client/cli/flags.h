// SPDX-License-Identifier: Apache-2.0
//
// The flags of one command. Abseil's flags are global to a process; these belong to a command, so
// that `sightline view --help` lists what view understands, and commands may run side by side in
// tests.
//
// --name VALUE and --name=VALUE both work; --name alone sets a switch and --no-name clears it; --
// ends the flags. A value may start with a minus. Unknown flags name the nearest known one.
//
// Thread safety: none; one FlagSet belongs to one command that runs. Targets must outlive it.
//
//   FlagSet flags("sightline view SCENE [flags]", "Traces what a camera sees.");
//   flags.Number("fov", "DEGREES", "vertical field of view, 0 to 180", &fov);
//   absl::StatusOr<std::vector<std::string>> words = flags.Parse(args);
#ifndef SIGHTLINE_CLIENT_CLI_FLAGS_H_
#define SIGHTLINE_CLIENT_CLI_FLAGS_H_

#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"
#include "core/geometry/vec3.h"

namespace sightline::cli {

// X,Y,Z, all finite.
absl::StatusOr<Vec3d> ParsePoint(absl::string_view text);

class FlagSet {
 public:
  FlagSet(std::string usage, std::string description)
      : usage_(std::move(usage)), description_(std::move(description)) {}

  // `value` names the value in --help; the current value of the target is shown as the default.
  void Switch(std::string name, std::string help, bool* target);
  void Text(std::string name, std::string value, std::string help, std::string* target);
  void Texts(std::string name, std::string value, std::string help,
             std::vector<std::string>* target);
  void Number(std::string name, std::string value, std::string help, double* target);
  void Count(std::string name, std::string value, std::string help, uint64_t* target,
             uint64_t smallest, uint64_t largest);
  void Point(std::string name, std::string help, std::optional<Vec3d>* target);
  void Points(std::string name, std::string help, std::vector<Vec3d>* target);
  void Choice(std::string name, std::vector<std::string> choices, std::string help,
              std::string* target);
  // Anything else: `parse` takes the value.
  void Custom(std::string name, std::string value, std::string help, std::string default_text,
              std::function<absl::Status(const std::string&)> parse);
  // Starts a new group in --help.
  void Heading(std::string text) { headings_.emplace_back(flags_.size(), std::move(text)); }

  // The words that are no flags. Usage errors name the flag, its value and what is allowed.
  absl::StatusOr<std::vector<std::string>> Parse(std::span<const std::string> args);

  // After Parse: --help or -h was there (nothing else was then checked).
  bool help_requested() const { return help_requested_; }
  // After Parse: whether the flag was on the command line.
  bool given(absl::string_view name) const;
  // Usage, description and every flag with its default.
  std::string Help() const;

 private:
  struct Flag {
    std::string name, value, help, default_text;
    bool is_switch = false;
    bool given = false;
    std::function<absl::Status(const std::string&)> parse;
  };
  Flag* Find(absl::string_view name);
  std::string Nearest(absl::string_view name) const;
  void Add(Flag flag) { flags_.push_back(std::move(flag)); }

  std::string usage_, description_;
  std::vector<Flag> flags_;
  std::vector<std::pair<size_t, std::string>> headings_;
  bool help_requested_ = false;
};

}  // namespace sightline::cli

#endif  // SIGHTLINE_CLIENT_CLI_FLAGS_H_
