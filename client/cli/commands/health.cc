// SPDX-License-Identifier: Apache-2.0
//
// sightline health: is the server there, and what can it do?
#include <memory>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "client/cli/commands/command.h"
#include "client/cli/exit_code.h"
#include "client/cli/session.h"
#include "core/base/status_macros.h"

namespace sightline::cli {
namespace {

const char* HealthName(client::Health health) {
  switch (health) {
    case client::Health::kServing:
      return "serving";
    case client::Health::kNotServing:
      return "not serving";
    case client::Health::kServiceUnknown:
      return "service unknown";
    case client::Health::kUnknown:
      break;
  }
  return "unknown";
}

}  // namespace

absl::Status HealthCommand(std::span<const std::string> args, Context& context) {
  std::string service, output;
  SessionFlags session_flags;
  FlagSet flags(
      "sightline health [flags]",
      "Tells whether a server serves and what it can do; without --server, of the one that "
      "commands start in their own process.");
  flags.Text("service", "NAME",
             "the health service's name to ask about; none: the server as a whole", &service);
  RegisterOutput(&flags, &output);
  session_flags.Register(&flags, /*embeddable=*/true);
  std::vector<std::string> words;
  SL_ASSIGN_OR_RETURN(bool go, ParseOrHelp(&flags, args, {}, "", context, &words));
  if (!go) return absl::OkStatus();
  SL_ASSIGN_OR_RETURN(std::unique_ptr<Session> session,
                      Session::Open(session_flags, context.interruption.calls()));
  SL_ASSIGN_OR_RETURN(client::Health health,
                      session->client().CheckHealth(service, session->call()));
  if (health == client::Health::kServiceUnknown) {
    return absl::NotFoundError(absl::StrCat("the server knows no service '", service, "'"));
  }
  SL_ASSIGN_OR_RETURN(client::Capabilities c, session->client().GetCapabilities(session->call()));
  const client::Limits& l = c.limits;
  const std::string where = session->embedded() ? "embedded" : session_flags.server;
  if (output == "json") {
    Json limits;
    limits["max_message_bytes"] = l.max_message_bytes;
    limits["max_item_rays"] = l.max_item_rays;
    limits["stream_credit_rays"] = l.stream_credit_rays;
    limits["max_queued_rays"] = l.max_queued_rays;
    limits["max_lights"] = l.max_lights;
    limits["max_light_samples"] = l.max_light_samples;
    limits["max_image_width"] = l.max_image_width;
    limits["max_image_height"] = l.max_image_height;
    limits["max_scenes"] = l.max_scenes;
    limits["max_triangles_per_scene"] = l.max_triangles_per_scene;
    limits["max_scene_bytes"] = l.max_scene_bytes;
    Json json;
    json["server"] = where;
    json["health"] = HealthName(health);
    json["version"] = c.version;
    json["instruction_set"] = c.instruction_set;
    json["threads"] = c.threads;
    json["strategies"] = c.strategies;
    json["builtin_scenes"] = c.builtin_scenes;
    json["limits"] = std::move(limits);
    PrintJson(json, context.out);
  } else {
    PrintTable(
        {{"server", where},
         {"health", HealthName(health)},
         {"version", c.version},
         {"instruction set", c.instruction_set},
         {"threads", absl::StrCat(c.threads)},
         {"strategies", absl::StrJoin(c.strategies, ", ")},
         {"built-in scenes", absl::StrJoin(c.builtin_scenes, ", ")},
         {"triangles per scene", absl::StrCat("at most ", GroupedCount(l.max_triangles_per_scene))},
         {"memory for scenes", absl::StrCat(GroupedCount(l.max_scene_bytes), " bytes")}},
        context.out);
  }
  if (health == client::Health::kServing) return absl::OkStatus();
  return absl::UnavailableError(absl::StrCat(where, " is ", HealthName(health)));
}

}  // namespace sightline::cli
