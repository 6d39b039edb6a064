// SPDX-License-Identifier: Apache-2.0
#include "client/cli/view_choice.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "absl/strings/str_cat.h"
#include "client/cli/exit_code.h"
#include "core/base/status_macros.h"

namespace sightline::cli {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

Vec3d Unit(Vec3d v) { return v * (1.0 / Length(v)); }
Vec3d ToVec(const client::Point3& p) { return {p[0], p[1], p[2]}; }

// A right-handed frame about `up`: two level directions and up.
struct Frame {
  explicit Frame(Vec3d u) : up(Unit(u)) {
    const Vec3d other = std::abs(up.x) < 0.9 ? Vec3d{1, 0, 0} : Vec3d{0, 0, -1};
    front = Unit(Cross(other, up));
    // With y up the front is +z, with z up it is -y, as modellers have it.
    side = Cross(up, front);
    if (Dot(side, other) < 0) side = -side, front = -front;
  }
  // Turned by `azimuth` from the front toward the side, raised by `elevation`; degrees.
  Vec3d Direction(double azimuth, double elevation) const {
    const double a = azimuth * std::numbers::pi / 180, e = elevation * std::numbers::pi / 180;
    return (front * std::cos(a) + side * std::sin(a)) * std::cos(e) + up * std::sin(e);
  }
  Vec3d up, front, side;
};

// Directions spread evenly over the sphere: a Fibonacci lattice.
std::vector<Vec3d> SphereDirections(int count) {
  std::vector<Vec3d> directions;
  const double turn = std::numbers::pi * (3.0 - std::sqrt(5.0));
  for (int i = 0; i < count; ++i) {
    const double z = 1.0 - (2.0 * i + 1.0) / count;
    const double r = std::sqrt(1.0 - z * z);
    directions.push_back({r * std::cos(turn * i), r * std::sin(turn * i), z});
  }
  return directions;
}

double Halton(int index, int base) {
  double fraction = 1, value = 0;
  for (int i = index; i > 0; i /= base) {
    fraction /= base;
    value += fraction * (i % base);
  }
  return value;
}

// What stands around some points: per point and direction how far it is free, and whether the front
// of a triangle ends it (known for files alone, whose arrays are at hand).
struct Surroundings {
  size_t directions = 0;
  std::vector<double> distance;  // kInfinity: free as far as the scene goes.
  std::vector<int> facing;       // 1 front, -1 back, 0 not known or free.
  double at(size_t point, size_t direction) const {
    return distance[point * directions + direction];
  }
};

int Facing(const std::vector<ObjectInput>& objects, uint32_t object, uint32_t triangle,
           Vec3d direction) {
  if (object >= objects.size()) return 0;
  const ObjectInput& o = objects[object];
  if (size_t{triangle} * 3 + 2 >= o.indices.size()) return 0;
  Vec3d corner[3];
  for (size_t k = 0; k < 3; ++k) {
    corner[k] = o.transform.Apply(o.vertices[o.indices[size_t{triangle} * 3 + k]]);
  }
  const double d = Dot(Cross(corner[1] - corner[0], corner[2] - corner[0]), direction);
  return d < 0 ? 1 : d > 0 ? -1 : 0;
}

absl::StatusOr<Surroundings> LookAround(const Session& session, const OpenedScene& scene,
                                        const std::vector<Vec3d>& points,
                                        const std::vector<Vec3d>& directions, double reach) {
  std::vector<double> segments;
  segments.reserve(points.size() * directions.size() * 6);
  for (const Vec3d& p : points) {
    for (const Vec3d& d : directions) {
      const Vec3d end = p + d * reach;
      segments.insert(segments.end(), {p.x, p.y, p.z, end.x, end.y, end.z});
    }
  }
  client::SegmentQuery query;
  query.scene = scene.scene().name;
  query.options.revision = scene.scene().revision;
  query.origin = scene.scene().origin;
  query.segments = segments;
  query.blockers = true;
  SL_ASSIGN_OR_RETURN(client::Segments found,
                      session.client().TestAllSegments(query, session.stream()));
  Surroundings around;
  around.directions = directions.size();
  for (size_t i = 0; i < found.blocked.size(); ++i) {
    const bool blocked = found.blocked[i] == 1;
    around.distance.push_back(blocked ? double{found.blocker_distance[i]} * reach : kInfinity);
    around.facing.push_back(blocked ? Facing(scene.objects(), found.blocker_object[i],
                                             found.blocker_triangle[i],
                                             directions[i % directions.size()])
                                    : 0);
  }
  return around;
}

// Three lights about a view from outside: a key from the left above, a fill from the right, one
// from above and behind.
std::vector<Vec3d> OutsideLights(const Box3d& bounds, Vec3d eye, Vec3d at, const Frame& frame) {
  const double reach = std::max(Length(bounds.Extent()), std::numeric_limits<double>::min());
  Vec3d back = eye - at;
  back = back - frame.up * Dot(back, frame.up);
  back = Length(back) > 0 ? Unit(back) : frame.front;
  const Vec3d right = Cross(frame.up, back);
  const Vec3d middle = (bounds.lo + bounds.hi) * 0.5;
  return {middle + (right * -0.9 + back * 0.7 + frame.up * 1.1) * reach,
          middle + (right * 1.2 + back * 0.5 + frame.up * 0.6) * reach,
          middle + (right * 0.2 + back * -0.9 + frame.up * 1.3) * reach};
}

// Three lights in the room that the eye is in, each on a free sight line of the eye, half way
// along: one up to the left, one up to the right, one ahead.
absl::StatusOr<std::vector<Vec3d>> InsideLights(const Session& session, const OpenedScene& scene,
                                                Vec3d eye, Vec3d at, const Frame& frame,
                                                double reach) {
  Vec3d ahead = at - eye;
  ahead = ahead - frame.up * Dot(ahead, frame.up);
  ahead = Length(ahead) > 0 ? Unit(ahead) : frame.front;
  const Vec3d right = Cross(ahead, frame.up);
  const std::vector<Vec3d> directions = {Unit(ahead * 0.9 - right * 0.9 + frame.up * 0.45),
                                         Unit(ahead * 0.9 + right * 0.7 + frame.up * 0.35),
                                         Unit(ahead + frame.up * 0.12)};
  SL_ASSIGN_OR_RETURN(Surroundings around, LookAround(session, scene, {eye}, directions, reach));
  std::vector<Vec3d> lights;
  for (size_t k = 0; k < directions.size(); ++k) {
    lights.push_back(eye + directions[k] * (0.6 * std::min(around.at(0, k), 0.5 * reach)));
  }
  return lights;
}

// Shares of directions that must be blocked around a place for it to count as enclosed.
constexpr double kRoomEnclosure = 0.9;
// Added to shares of `reach` before their logarithm: what is nearer than a thousandth is just near.
constexpr double kNearest = 1.0 / 1024;
// Half of all sight lines ended nearby: lights belong inside.
constexpr double kLightEnclosure = 0.5;

// The place in a room that sees farthest, and where it looks; nullopt if the scene is no room.
absl::StatusOr<std::optional<ViewChoice>> LookInside(const Session& session,
                                                     const OpenedScene& scene, const Box3d& bounds,
                                                     const Frame& frame, double reach) {
  constexpr int kPlaces = 96, kDirections = 64;
  const Vec3d extent = bounds.Extent();
  std::vector<Vec3d> places;
  for (int i = 1; i <= kPlaces; ++i) {
    // Level: anywhere but near the walls. High: where eyes are, between a third and six tenths.
    const double share[3] = {0.08 + 0.84 * Halton(i, 2), 0.08 + 0.84 * Halton(i, 3),
                             0.33 + 0.27 * Halton(i, 5)};
    Vec3d place = bounds.lo;
    int level = 0;
    for (int axis = 0; axis < 3; ++axis) {
      const bool is_up = std::abs(frame.up[axis]) > 0.5;
      const double s = is_up ? (frame.up[axis] > 0 ? share[2] : 1 - share[2]) : share[level++ & 1];
      place[axis] += s * extent[axis];
    }
    places.push_back(place);
  }
  const std::vector<Vec3d> directions = SphereDirections(kDirections);
  SL_ASSIGN_OR_RETURN(Surroundings around, LookAround(session, scene, places, directions, reach));
  // A place in a room is closed in by fronts; one within a solid body is closed in by backs.
  int rooms = 0;
  double best_score = 0;
  size_t best_place = 0;
  for (size_t p = 0; p < places.size(); ++p) {
    int blocked = 0, front = 0, back = 0;
    double openness = 0;
    for (size_t d = 0; d < directions.size(); ++d) {
      const double distance = around.at(p, d);
      if (std::isfinite(distance)) ++blocked;
      front += around.facing[p * directions.size() + d] > 0 ? 1 : 0;
      back += around.facing[p * directions.size() + d] < 0 ? 1 : 0;
      openness += std::log(std::min(distance, reach) / reach + kNearest);
    }
    if (blocked < kRoomEnclosure * kDirections || front <= 2 * back) continue;
    ++rooms;
    // Sums of logarithms: one long corridor does not outweigh a wall before the nose.
    const double score = std::exp(openness / kDirections);
    if (score > best_score) best_score = score, best_place = p;
  }
  // A hollow here and there (a pot, a box) does not make a room of the whole.
  if (rooms * 3 < kPlaces) return std::nullopt;

  // Where to look: level, the way that is free farthest over the width of a picture.
  constexpr int kTurns = 72;
  std::vector<Vec3d> turns;
  turns.reserve(kTurns);
  for (int i = 0; i < kTurns; ++i) turns.push_back(frame.Direction(360.0 * i / kTurns, -4));
  SL_ASSIGN_OR_RETURN(Surroundings level,
                      LookAround(session, scene, {places[best_place]}, turns, reach));
  int best_turn = 0;
  double best_free = -kInfinity;
  for (int i = 0; i < kTurns; ++i) {
    double free = 0;
    for (int k = -6; k <= 6; ++k) {  // 13 · 5 degrees: about a picture's width.
      const auto turn = static_cast<size_t>((i + k + kTurns) % kTurns);
      free += std::log(std::min(level.at(0, turn), reach) / reach + kNearest);
    }
    if (free > best_free) best_free = free, best_turn = i;
  }
  ViewChoice view;
  view.eye = places[best_place];
  view.at = view.eye + turns[static_cast<size_t>(best_turn)] * (0.2 * reach);
  view.up = frame.up;
  view.fov_y_degrees = 65;
  view.how = "inside";
  return view;
}

}  // namespace

Vec3d GuessUp(const Box3d& bounds, const std::string& format) {
  const Vec3d e = bounds.Extent();
  const bool flat = 3 * e.z < std::min(e.x, e.y);
  return flat || format.substr(0, 3) == "stl" ? Vec3d{0, 0, 1} : Vec3d{0, 1, 0};
}

absl::StatusOr<Vec3d> SceneUp(const OpenedScene& scene, const std::optional<Vec3d>& flag) {
  if (flag) {
    const double size = MaxAbs(*flag);
    if (!(size > 0) || !std::isfinite(size)) {
      return UsageError(absl::StrCat("--up = (", flag->x, ", ", flag->y, ", ", flag->z,
                                     ") has no direction; give a finite vector that is not zero"));
    }
    // No square of it over- or underflows then; a power of two, so that no answer depends on it.
    const int e = -std::ilogb(size);
    return Vec3d{std::ldexp(flag->x, e), std::ldexp(flag->y, e), std::ldexp(flag->z, e)};
  }
  if (scene.builtin_view()) return scene.builtin_view()->up;
  const auto& bounds = scene.scene().bounds;
  return GuessUp(bounds ? Box3d{ToVec((*bounds)[0]), ToVec((*bounds)[1])} : Box3d{},
                 scene.format());
}

Vec3d FitBox(const Box3d& bounds, Vec3d toward_eye, Vec3d up, double fov_y_degrees, double aspect) {
  const Vec3d middle = (bounds.lo + bounds.hi) * 0.5;
  const Vec3d back = Unit(toward_eye);
  Vec3d right = Cross(up, back);
  right = Length(right) > 0 ? Unit(right) : Vec3d{1, 0, 0};
  const Vec3d image_up = Cross(back, right);
  constexpr double kMargin = 1.06;
  const double tan_y = std::tan(fov_y_degrees * std::numbers::pi / 360) / kMargin;
  const double tan_x = tan_y * aspect;
  // With x across, y up and z toward the eye, and the eye at (x, y, d), a corner is within the
  // picture when |corner.x − x| <= tan_x (d − corner.z), and likewise for y: corner.x + tan_x
  // corner.z and corner.x − tan_x corner.z bound x from both sides, and d is the least that leaves
  // room between.
  double x_low = kInfinity, x_high = -kInfinity, y_low = kInfinity, y_high = -kInfinity;
  for (int i = 0; i < 8; ++i) {
    const Vec3d corner =
        Vec3d{(i & 1) != 0 ? bounds.hi.x : bounds.lo.x, (i & 2) != 0 ? bounds.hi.y : bounds.lo.y,
              (i & 4) != 0 ? bounds.hi.z : bounds.lo.z} -
        middle;
    const double x = Dot(corner, right), y = Dot(corner, image_up), z = Dot(corner, back);
    x_low = std::min(x_low, x - tan_x * z);
    x_high = std::max(x_high, x + tan_x * z);
    y_low = std::min(y_low, y - tan_y * z);
    y_high = std::max(y_high, y + tan_y * z);
  }
  double distance = std::max((x_high - x_low) / (2 * tan_x), (y_high - y_low) / (2 * tan_y));
  // A scene that is a point: anywhere off it.
  if (!(distance > 0)) distance = 1;
  return middle + back * distance + right * (0.5 * (x_low + x_high)) +
         image_up * (0.5 * (y_low + y_high));
}

absl::StatusOr<ViewChoice> ChooseView(const Session& session, const OpenedScene& scene,
                                      const std::string& name, const ViewFlags& flags,
                                      double aspect) {
  if (!scene.scene().bounds) {
    return absl::InvalidArgumentError(
        absl::StrCat("'", name, "': none of its ", scene.scene().triangles,
                     " triangles can be hit (no area, or corners that are not finite)"));
  }
  const Box3d bounds{ToVec((*scene.scene().bounds)[0]), ToVec((*scene.scene().bounds)[1])};
  const double diagonal = Length(bounds.Extent());
  SL_ASSIGN_OR_RETURN(const Vec3d up, SceneUp(scene, flags.up));
  ViewChoice view;
  if (scene.builtin_view()) {
    const BuiltinView& own = *scene.builtin_view();
    view = {own.eye, own.at, up, own.fov_y_degrees, own.lights, "built-in"};
    if (flags.eye) view.eye = *flags.eye;
    if (flags.at) view.at = *flags.at;
    if (flags.fov_y_degrees) view.fov_y_degrees = *flags.fov_y_degrees;
    if (flags.eye || flags.at) view.how = "given";
    return view;
  }
  view.up = up;
  const Frame frame(view.up);
  // A sight line of this length that starts within the bounds leaves them.
  const double reach = 1.1 * diagonal;
  const auto middle = (bounds.lo + bounds.hi) * 0.5;
  if (flags.eye) {
    view.eye = *flags.eye;
    view.at = flags.at ? *flags.at : middle;
    view.how = "given";
  } else {
    if (flags.fov_y_degrees) view.fov_y_degrees = *flags.fov_y_degrees;
    // What is flat is looked at from higher up.
    const Vec3d e = bounds.Extent();
    const double high =
        std::abs(Dot(e, {std::abs(frame.up.x), std::abs(frame.up.y), std::abs(frame.up.z)}));
    const double elevation = 4 * high < diagonal ? 40 : 25;
    const Vec3d toward_eye = frame.Direction(35, elevation);
    view.eye =
        FitBox(bounds, toward_eye, view.up, std::clamp(view.fov_y_degrees, 1.0, 170.0), aspect);
    view.at = view.eye - toward_eye * Dot(view.eye - middle, toward_eye);
    view.how = "outside";
    if (flags.at) {
      view.eye = view.eye + (*flags.at - view.at);
      view.at = *flags.at;
      view.how = "given";
    } else if (diagonal > 0) {
      SL_ASSIGN_OR_RETURN(std::optional<ViewChoice> inside,
                          LookInside(session, scene, bounds, frame, reach));
      if (inside) view = *inside;
    }
  }
  if (flags.fov_y_degrees) view.fov_y_degrees = *flags.fov_y_degrees;

  const bool within = view.eye.x > bounds.lo.x && view.eye.y > bounds.lo.y &&
                      view.eye.z > bounds.lo.z && view.eye.x < bounds.hi.x &&
                      view.eye.y < bounds.hi.y && view.eye.z < bounds.hi.z;
  if (within) {
    const std::vector<Vec3d> directions = SphereDirections(64);
    SL_ASSIGN_OR_RETURN(Surroundings around,
                        LookAround(session, scene, {view.eye}, directions, reach));
    const auto blocked = std::count_if(around.distance.begin(), around.distance.end(),
                                       [](double d) { return std::isfinite(d); });
    if (static_cast<double>(blocked) >= kLightEnclosure * static_cast<double>(directions.size())) {
      SL_ASSIGN_OR_RETURN(view.lights,
                          InsideLights(session, scene, view.eye, view.at, frame, reach));
      return view;
    }
  }
  view.lights = OutsideLights(bounds, view.eye, view.at, frame);
  return view;
}

absl::StatusOr<std::vector<client::Light>> LightsOf(const LightFlags& flags, const ViewChoice& view,
                                                    uint64_t chosen) {
  SL_ASSIGN_OR_RETURN(std::vector<client::Light> lights, flags.Lights(view.up));
  if (!lights.empty()) return lights;
  for (size_t k = 0; k < std::min<size_t>(chosen, view.lights.size()); ++k) {
    const Vec3d at = view.lights[k];
    lights.push_back(client::Light::Point({at.x, at.y, at.z}));
  }
  return lights;
}

}  // namespace sightline::cli
