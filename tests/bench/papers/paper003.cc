// SPDX-License-Identifier: Apache-2.0
//
// Paper 003 (Havel and Herout): Tables I and II, on its synthetic triangles; the engine's own test,
// the predicate, beside them (predicate_passes.h).
#include <algorithm>
#include <array>
#include <limits>
#include <optional>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "core/base/check.h"
#include "core/intersect/intersector.h"
#include "tests/bench/papers/intersector_passes.h"
#include "tests/bench/papers/papers.h"
#include "tests/bench/papers/precision.h"
#include "tests/bench/papers/predicate_passes.h"
#include "tests/bench/papers/synthetic.h"

namespace sightline::bench {
namespace {

constexpr size_t kTriangles = 256;  // 12 kB prepared: in the first cache, as the paper's are.
constexpr size_t kPackets = 64;
constexpr size_t kPacketRays = 16;         // Packets of 4 and 8 are parts of them.
constexpr size_t kEnginePacketRays = 256;  // Of the engine's own packets, as many rays in all.
constexpr double kJitter = 0.04;

// The paper's own figures, of Microsoft's compiler: millions a second on a Core 2 Duo E8200.
struct Published {
  std::optional<double> single, single_worst, packet, packet_worst, preparation;
};
Published PublishedOf(Intersector kind) {
  switch (kind) {
    case Intersector::kWald:
      return {109, 44, 390, 173, 26};
    case Intersector::kShevtsov:
      return {107, 46, 391, 179, 32.1};
    case Intersector::kHavelHerout:
      return {115, 44, 427, 177, 35.5};
    case Intersector::kHavelHeroutDotProduct:
      return {149, 48, std::nullopt, std::nullopt, std::nullopt};
    default:
      return {};
  }
}

Row OrNull(std::optional<double> value) { return value ? Row(*value) : Row(nullptr); }

struct Measured {
  PassSpec spec;
  size_t data = 0;         // Which of the intersectors' arrays, or of the predicate's.
  double rate = 0;         // Million tests a second.
  size_t packet_rays = 0;  // Of the predicate's packets; else there are as many as lanes.
  bool distances = true;   // Whether the predicate's hits get theirs.
};

std::string TestName(const Measured& m) {
  return absl::StrCat(IntersectorName(m.spec.kind), m.distances ? "" : ", hits alone");
}

std::string FormName(const Measured& m) {
  switch (m.spec.form) {
    case PassForm::kOne:
      return "single";
    case PassForm::kTriangles:
      return absl::StrCat("single, ", m.spec.lanes, " triangles");
    case PassForm::kRays:
      // Short: it stands below a plot.
      return m.packet_rays > static_cast<size_t>(m.spec.lanes)
                 ? absl::StrCat(m.packet_rays, " rays, ", m.spec.lanes, " lanes")
                 : absl::StrCat("packets of ", m.spec.lanes);
  }
  return "";
}

std::vector<Measured> AllSpecs() {
  std::vector<Measured> all;
  for (size_t k = 0; k < kPaperIntersectors.size(); ++k) {
    const Intersector kind = kPaperIntersectors[k];
    for (const bool worst : {false, true}) {
      all.push_back({{kind, PassForm::kOne, 1, worst}, k});
      if (kind == Intersector::kHavelHeroutDotProduct) continue;  // One at a time alone.
      for (const PassForm form : {PassForm::kTriangles, PassForm::kRays}) {
        for (const int lanes : {4, 8, 16}) {
          if (HasLanes(lanes)) all.push_back({{kind, form, lanes, worst}, k});
        }
      }
    }
  }
  return all;
}

// The same rays and triangles for the predicate: as packets of 8, 16 and, of other rays, 256.
constexpr std::array<size_t, 3> kPredicatePackets = {8, kPacketRays, kEnginePacketRays};

// The predicate's, of as many lanes as its walks are compiled for.
std::vector<Measured> PredicateSpecs() {
  std::vector<Measured> all;
  for (const bool distances : {true, false}) {
    for (const int lanes : {8, 16}) {
      if (!HasLanes(lanes)) continue;
      // Rays by themselves are the same, however they are cut.
      all.push_back(
          {{Intersector::kExact, PassForm::kTriangles, lanes, false}, 0, 0, 0, distances});
      for (size_t k = 0; k < kPredicatePackets.size(); ++k) {
        const size_t rays = kPredicatePackets[k];
        if (rays != static_cast<size_t>(lanes) && rays != kEnginePacketRays) continue;
        all.push_back(
            {{Intersector::kExact, PassForm::kRays, lanes, false}, k, 0, rays, distances});
      }
    }
  }
  return all;
}

double RateOf(const std::vector<Measured>& all, Intersector kind, PassForm form, int lanes,
              bool worst) {
  for (const Measured& m : all) {
    if (m.spec.kind == kind && m.spec.form == form && m.spec.lanes == lanes &&
        m.spec.worst == worst) {
      return m.rate;
    }
  }
  SIGHTLINE_CHECK(false) << "not measured";
  return 0;
}

// Of the paper's tests, and those that they are compared with.
double BestRateOf(const std::vector<Measured>& all, PassForm form, int lanes, bool worst) {
  double best = 0;
  for (const Measured& m : all) {
    if (m.spec.form == form && m.spec.lanes == lanes && m.spec.worst == worst) {
      best = std::max(best, m.rate);
    }
  }
  return best;
}

// `all`: the papers' tests; `predicate`: its passes.
void TableOne(const std::vector<Measured>& all, const std::vector<Measured>& predicate,
              double hit_share, PaperReport* report) {
  report->Begin(
      "003", "Table I",
      absl::StrFormat("million ray-triangle tests a second; %d triangles, %.0f %% of tests hit; 4 "
                      "lanes are SSE's width, 8 AVX2's, 16 AVX-512's; of_best: over the fastest of "
                      "the papers' tests in the same form, of_best_worst in its worst case. EXACT "
                      "is the predicate as the engine's walks ask it: it prepares nothing for a "
                      "scene, and what a packet shares of a triangle is made within the time; the "
                      "nearest hit ends no test of it early, so that its worst case is its "
                      "ordinary one; every hit's distance is found in doubles, or (hits alone, as "
                      "for shadows) none. The paper's figures (Core 2 Duo E8200, its packets have "
                      "4 rays) beside",
                      kTriangles, 100 * hit_share));
  std::vector<Measured> rows = all;
  rows.insert(rows.end(), predicate.begin(), predicate.end());
  for (const Measured& m : rows) {
    if (m.spec.worst) continue;
    const Published paper = PublishedOf(m.spec.kind);
    const PassForm form = m.spec.form;
    const int lanes = m.spec.lanes;
    const double worst_rate =
        m.spec.kind == Intersector::kExact ? m.rate : RateOf(all, m.spec.kind, form, lanes, true);
    Row row = {{"test", TestName(m)},
               {"form", FormName(m)},
               {"ordinary", m.rate},
               {"worst", worst_rate},
               {"of_wald", m.rate / RateOf(all, Intersector::kWald, form, lanes, false)},
               {"of_best", m.rate / BestRateOf(all, form, lanes, false)},
               {"of_best_worst", worst_rate / BestRateOf(all, form, lanes, true)}};
    std::optional<double> ordinary, worst;
    if (m.spec.form == PassForm::kOne) {
      ordinary = paper.single;
      worst = paper.single_worst;
    } else if (m.spec.form == PassForm::kRays && m.spec.lanes == 4) {
      ordinary = paper.packet;
      worst = paper.packet_worst;
    }
    row["paper_ordinary"] = OrNull(ordinary);
    row["paper_worst"] = OrNull(worst);
    report->Add(std::move(row));
  }
  const double wald = RateOf(all, Intersector::kWald, PassForm::kOne, 1, false);
  const double one = RateOf(all, Intersector::kHavelHerout, PassForm::kOne, 1, false);
  const double dots = RateOf(all, Intersector::kHavelHeroutDotProduct, PassForm::kOne, 1, false);
  const double divided = RateOf(all, Intersector::kHavelHeroutDivided, PassForm::kOne, 1, false);
  const double packets = RateOf(all, Intersector::kHavelHerout, PassForm::kRays, 4, false);
  const double wald_packets = RateOf(all, Intersector::kWald, PassForm::kRays, 4, false);
  report->Conclude(absl::StrFormat(
      "Single rays: the paper's test is %.2f times Wald's without and %.2f with the dot-product "
      "instruction (paper: 1.06 and 1.37).",
      one / wald, dots / wald));
  report->Claim({"single rays: gain over Wald's test, without the instruction", "1.06",
                 absl::StrFormat("%.2f", one / wald), VerdictOfGain(one / wald, 1.06),
                 "Wald's test has fewer operations, and a division costs less than it did"});
  report->Claim({"single rays: gain of the dot-product form over Wald's test", "1.37",
                 absl::StrFormat("%.2f", dots / wald), VerdictOfGain(dots / wald, 1.37),
                 "the instruction has a latency of a dozen cycles on today's cores and is several "
                 "micro-operations, where three multiply-adds run side by side: registers are "
                 "better filled with triangles than with one triangle's coordinates"});
  report->Claim({"packets of 4: gain over Wald's test", "1.09",
                 absl::StrFormat("%.2f", packets / wald_packets),
                 VerdictOfGain(packets / wald_packets, 1.09),
                 "Wald's test has fewer operations, and a division costs less than it did"});
  report->Conclude(
      absl::StrFormat("Deferring the division gains %.2f for single rays.", one / divided));
  report->Conclude(
      absl::StrFormat("Packets of 4: %.2f times Wald's (paper: 1.09).", packets / wald_packets));
  const int widest = HasLanes(16) ? 16 : 8;
  report->Conclude(absl::StrFormat(
      "What registers of today give a single ray is triangles in lanes: %d of them run at %.1f "
      "times the dot-product form.",
      widest, RateOf(all, Intersector::kHavelHerout, PassForm::kTriangles, widest, false) / dots));
  for (const Measured& m : predicate) {
    if (m.spec.lanes != widest) continue;
    report->Conclude(absl::StrFormat(
        "%s (the predicate, exact and with nothing prepared), %s: %.2f of the fastest of the "
        "papers' tests, %.2f in the worst case.",
        TestName(m), FormName(m), m.rate / BestRateOf(all, m.spec.form, widest, false),
        m.rate / BestRateOf(all, m.spec.form, widest, true)));
  }
  report->Plot({.x = "form", .y = "ordinary", .series = "test", .bars = true});
  report->Plot({.x = "form", .y = "worst", .series = "test", .bars = true});
  report->End();
}

void TableTwo(const std::vector<PassData>& data, std::vector<PredicateData>* predicate,
              uint64_t repeats, PaperReport* report) {
  struct Side {
    Intersector kind;
    size_t data;
    int lanes;
  };
  std::vector<Side> sides;
  for (size_t k = 0; k < kPaperIntersectors.size(); ++k) {
    const Intersector kind = kPaperIntersectors[k];
    // Raw corners need none; without deferring, the same planes are prepared.
    if (!PublishedOf(kind).preparation) continue;
    sides.push_back({kind, k, 1});
    if (kind != Intersector::kHavelHerout) continue;
    for (const int lanes : {4, 8, 16}) {
      if (HasLanes(lanes)) sides.push_back({kind, k, lanes});
    }
  }
  std::vector<std::function<void()>> calls;
  uint64_t sum = 0;
  for (const Side& side : sides) {
    calls.push_back(
        [&data, &sum, side] { sum += RunPreparation(side.kind, side.lanes, data[side.data]); });
  }
  // The predicate's, for each packet's origin: the packets' own share of it is small.
  PredicateData& origins = predicate->back();
  std::vector<int> exact;
  for (const int lanes : {8, 16}) {
    if (!HasLanes(lanes)) continue;
    exact.push_back(lanes);
    calls.push_back([&origins, &sum, lanes] { sum += RunPredicatePreparation(lanes, &origins); });
  }
  const std::vector<double> seconds = SecondsByTurns(calls, repeats);
  SIGHTLINE_CHECK_GT(sum, 0u);
  report->Begin("003", "Table II",
                "million triangles prepared a second; EXACT, the predicate, prepares none for a "
                "scene: this is what its packets make of a triangle for each origin anew");
  std::vector<double> one;
  for (size_t i = 0; i < sides.size(); ++i) {
    const double rate = kTriangles / seconds[i] * 1e-6;
    if (sides[i].lanes == 1) one.push_back(rate);
    report->Add({{"test", std::string(IntersectorName(sides[i].kind))},
                 {"form", sides[i].lanes == 1 ? "one at a time"
                                              : absl::StrCat(sides[i].lanes, " in lanes")},
                 {"rate", rate},
                 {"paper_rate", sides[i].lanes == 1 ? OrNull(PublishedOf(sides[i].kind).preparation)
                                : sides[i].lanes == 4 ? Row(50.3)
                                                      : Row(nullptr)}});
  }
  for (size_t i = 0; i < exact.size(); ++i) {
    const double made = kTriangles * static_cast<double>(origins.packets.size());
    report->Add({{"test", std::string(IntersectorName(Intersector::kExact))},
                 {"form", absl::StrCat(exact[i], " in lanes, for an origin")},
                 {"rate", made / seconds[sides.size() + i] * 1e-6},
                 {"paper_rate", nullptr}});
  }
  SIGHTLINE_CHECK_EQ(one.size(), 3u);  // In the order of kPaperIntersectors.
  report->Conclude(absl::StrFormat(
      "One at a time, the paper's test is prepared %.2f times as fast as Wald's and %.2f times as "
      "Shevtsov's (paper: 1.37 and 1.11).",
      one[0] / one[1], one[0] / one[2]));
  const char* const reason =
      "a triangle is prepared one at a time, in scalar code that the compiler orders as it likes: "
      "in lanes the paper's test has no axis to choose, and gains more";
  report->Claim({"preparing triangles: gain over Wald's test", "1.37",
                 absl::StrFormat("%.2f", one[0] / one[1]), VerdictOfGain(one[0] / one[1], 1.37),
                 reason});
  report->Claim({"preparing triangles: gain over Shevtsov's test", "1.11",
                 absl::StrFormat("%.2f", one[0] / one[2]), VerdictOfGain(one[0] / one[2], 1.11),
                 reason});
  report->Plot({.x = "form", .y = "rate", .series = "test", .bars = true});
  report->End();
}

void PrecisionTable(const SyntheticCell& cell, const std::vector<Vec3f>& origins,
                    const std::vector<Vec3f>& directions, PaperReport* report) {
  report->Begin("003", "precision",
                "against Kensler and Shirley's test in doubles: mean square relative errors of the "
                "distance and of the hit point's weights; tests that hit in one of them alone");
  double least = std::numeric_limits<double>::infinity(), most = 0;
  for (const Intersector kind : kPaperIntersectors) {
    const Precision p = PrecisionOf(kind, cell.triangles, origins, directions);
    report->Add({{"test", std::string(IntersectorName(kind))},
                 {"hits", p.hits},
                 {"otherwise", p.otherwise},
                 {"distance", p.t},
                 {"weights", p.point},
                 {"worst_distance", p.worst_t},
                 {"paper_weights", 1e-8}});
    least = std::min(least, p.point);
    most = std::max(most, p.point);
  }
  report->Claim({"mean square relative error of the hit point", "about 1e-8",
                 absl::StrFormat("%.1e to %.1e", least, most),
                 most <= (1 + kGainBand) * 1e-8 ? Verdict::kHolds
                 : least <= 1e-8                ? Verdict::kInPart
                                                : Verdict::kDoesNotHold,
                 "a mean square is that of the few hits beside a corner, whose weights are nearly "
                 "zero: it says more of the triangles than of the tests"});
  report->End();
}

}  // namespace

absl::Status Paper003(const PaperOptions& options, PaperReport* report, Context& context) {
  context.err << "paper 003: intersectors" << std::endl;
  const SyntheticCell cell = MakeCell(kTriangles, /*ratio=*/1, /*seed=*/3);
  Random random(4);
  std::vector<Vec3f> origins, directions;
  std::vector<SyntheticPacket> packets, large_packets;
  for (size_t p = 0; p < kPackets; ++p) {
    packets.push_back(MakePacket(kPacketRays, 1, kJitter, random));
    for (const Vec3f d : packets.back().directions) {
      origins.push_back(packets.back().origin);
      directions.push_back(d);
    }
  }
  for (size_t p = 0; p < kPackets * kPacketRays / kEnginePacketRays; ++p) {
    large_packets.push_back(MakePacket(kEnginePacketRays, 1, kJitter, random));
  }
  std::vector<PassData> data;
  for (const Intersector kind : kPaperIntersectors) {
    data.push_back(MakePassData(kind, cell.triangles, origins, directions));
  }
  std::vector<Measured> all = AllSpecs();
  std::vector<std::function<void()>> calls;
  std::vector<uint64_t> hits(all.size());
  for (size_t i = 0; i < all.size(); ++i) {
    calls.push_back([&all, &data, &hits, i] { hits[i] = RunPass(all[i].spec, data[all[i].data]); });
  }
  std::vector<PredicateData> predicate_data;
  for (const size_t rays : kPredicatePackets) {
    predicate_data.push_back(
        MakePredicateData(cell.triangles, rays > kPacketRays ? large_packets : packets, rays));
  }
  std::vector<Measured> predicate = PredicateSpecs();
  std::vector<uint64_t> rays_that_hit(predicate.size());
  for (size_t i = 0; i < predicate.size(); ++i) {
    calls.push_back([&predicate, &predicate_data, &rays_that_hit, i] {
      const PassSpec& spec = predicate[i].spec;
      rays_that_hit[i] = RunPredicatePass(spec.form, spec.lanes, predicate[i].distances,
                                          &predicate_data[predicate[i].data]);
    });
  }
  const std::vector<double> seconds = SecondsByTurns(calls, options.repeats);
  const double tests = static_cast<double>(data[0].tests());
  double hit_share = 0;
  for (size_t i = 0; i < all.size(); ++i) {
    all[i].rate = tests / seconds[i] * 1e-6;
    if (all[i].spec.worst) hit_share = static_cast<double>(hits[i]) / tests;
    SIGHTLINE_CHECK_GT(hits[i], 0u) << "a pass that hits nothing measures nothing";
  }
  for (size_t i = 0; i < predicate.size(); ++i) {
    SIGHTLINE_CHECK_EQ(predicate_data[predicate[i].data].tests(), data[0].tests());
    predicate[i].rate = tests / seconds[all.size() + i] * 1e-6;
    // Exact answers are the same ones in every form.
    if (predicate[i].packet_rays != kEnginePacketRays) {
      SIGHTLINE_CHECK_EQ(rays_that_hit[i], rays_that_hit[0]);
    }
    SIGHTLINE_CHECK_GT(rays_that_hit[i], 0u);
  }
  TableOne(all, predicate, hit_share, report);
  TableTwo(data, &predicate_data, options.repeats, report);
  PrecisionTable(cell, origins, directions, report);
  return absl::OkStatus();
}

}  // namespace sightline::bench
