// Checks and evaluations of a mechanism on its own; see mechanism_check.hpp.
#include "check/mechanism_check.hpp"

#include <algorithm>
#include <cstdio>

#include "check/coordinate_effects.hpp"
#include "check/mechanism_modes.hpp"
#include "check/reachable_range.hpp"
#include "contact/seated_play.hpp"
#include "docking/scene.hpp"
#include "docking/sequence_json.hpp"
#include "math/decompositions.hpp"
#include "math/status.hpp"
#include "mechanism/mechanism_dynamics.hpp"
#include "model/json_reader.hpp"

namespace dockloop {
namespace {

using nlohmann::json;

json to_json(const VecX<double>& v) { return std::vector<double>(v.data(), v.data() + v.size()); }

std::string describe_cut(CutType cut) {
  switch (cut) {
    case CutType::kUniversal:
      return "R2";
    case CutType::kPlanarRevolute:
      return "R1_planar";
    case CutType::kRevolute:
      return "R1";
    case CutType::kCoupling:
      return "coupling";
    case CutType::kSpherical:
      break;
  }
  return "R3";
}

/// Of a joint in a file, where no mode is.
const char* describe_joint(JointType joint) {
  if (joint == JointType::kFree) return "free";
  return joint == JointType::kRevolute ? "revolute" : "prismatic";
}

template <class Matrix>
json to_rows(const Matrix& m) {
  json rows = json::array();
  for (Eigen::Index i = 0; i < m.rows(); ++i) rows.push_back(to_json(m.row(i).transpose()));
  return rows;
}

/// Springs, dampers and stops of legs of the short form, as elements along their travel from home.
json describe_leg_forces(const MechanismModel& model) {
  json elements = json::array();
  for (const Leg& leg : model.legs) {
    if (!leg.law) continue;
    json laws = json::array();
    const double rest = leg.law->free_length - leg.home_length;
    if (leg.law->stiffness > 0.0) {
      const double balance = rest + leg.law->preload / leg.law->stiffness;
      const json stage = {0.0, leg.law->stiffness};
      laws.push_back({{"type", "spring"}, {"stages", {stage}}, {"rest", balance}});
    } else if (leg.law->preload != 0.0) {
      laws.push_back({{"type", "constant"}, {"force", leg.law->preload}});
    }
    if (leg.law->damping > 0.0) {
      laws.push_back({{"type", "damper"}, {"linear", leg.law->damping}});
    }
    if (leg.law->stops) laws.push_back({{"type", "stops of the short form"}});
    const json along = {{"joint", model.bodies[leg.body].name}, {"ratio", leg.arm}};
    if (!laws.empty()) {
      elements.push_back({{"name", leg.name}, {"along", {along}}, {"laws", laws}});
    }
  }
  return elements;
}

std::string describe_solution(const LoopBlock& block) {
  if (block.form()) return describe_leg(*block.form());
  return block.is_coupling ? "linear" : "newton";
}

double find_max_condition(const Mechanism& mechanism, const MechanismData<double>& data) {
  double largest = 1.0;
  for (size_t b = 0; b < mechanism.plan.blocks.size(); ++b) {
    const int m = mechanism.plan.blocks[b].size();
    const VecX<double> value = find_singular_values(data.loops.block[b].G.leftCols(m));
    largest = std::max(largest, value[0] / value[m - 1]);
  }
  return largest;
}

/// What a loop is, in words, when it cannot be evaluated.
std::string describe(const Status& status) {
  switch (status.code) {
    case StatusCode::kOutOfReach:
      return "cannot be reached";
    case StatusCode::kLoopSingular:
      return "is singular";
    case StatusCode::kBranchChanged:
      return "leaves its assembly branch";
    case StatusCode::kRedundancyLost:
      return "violates an equation that follows from others at home";
    case StatusCode::kInertiaNotPositive:
      return "inertia is not positive definite";
    default:
      return "cannot be closed";
  }
}

[[noreturn]] void fail_state(const std::string& source, size_t index, const Mechanism& mechanism,
                             const Status& status) {
  std::string text = source + ": state " + std::to_string(index + 1);
  if (status.index >= 0) {
    text += ", loop '" + mechanism.model.loops[status.index].name + "' " + describe(status);
  } else {
    text += ": the inertia in the independent coordinates is not positive definite";
  }
  throw ModelError(text);
}

std::vector<double> read_numbers(const JsonReader& state, const std::string& key, int count) {
  std::vector<double> values;
  for (const JsonReader& item : state.list(key)) values.push_back(item.number());
  if (static_cast<int>(values.size()) != count) {
    state.at(key).fail("has " + std::to_string(values.size()) + " numbers, expected " +
                       std::to_string(count));
  }
  return values;
}

/// What people call a joint with end stops: the leg, where it is one.
std::string find_joint_name(const MechanismModel& model, int body) {
  for (const Leg& leg : model.legs) {
    if (leg.body == body) return leg.name;
  }
  return model.bodies[body].name;
}

/// Ranges of the independent coordinates, with what ends them.
json describe_ranges(const Mechanism& mechanism) {
  json list = json::array();
  for (const CoordinateRange& range : find_reachable_ranges(mechanism)) {
    json row = {{"coordinate", range.coordinate}, {"unit", range.is_angle ? "rad" : "m"}};
    const auto add_end = [&](const std::string& side, const RangeEnd& end) {
      row[side] = end.value;
      row[side + "_end"] = "no loop ends it";
      if (!end.status.ok()) {
        const int loop = end.status.index;
        row[side + "_end"] = (loop < 0 ? "" : "loop '" + mechanism.model.loops[loop].name + "' ") +
                             describe(end.status);
      }
      if (end.stopped_body == kBase) return;
      row[side + "_stop"] = {{"at", end.stop},
                             {"joint", find_joint_name(mechanism.model, end.stopped_body)}};
    };
    add_end("lower", range.lower);
    add_end("upper", range.upper);
    list.push_back(row);
  }
  return list;
}

json describe_parts(const std::vector<MovedPart>& parts) {
  json rates = json::array();
  for (const MovedPart& part : parts) rates.push_back({{"name", part.name}, {"rate", part.rate}});
  return rates;
}

/// What each independent coordinate moves at home.
json describe_effects(const Mechanism& mechanism) {
  json list = json::array();
  for (const CoordinateEffect& effect : find_coordinate_effects(mechanism)) {
    list.push_back({{"coordinate", effect.coordinate},
                    {"unit", effect.is_angle ? "rad" : "m"},
                    {"elements", describe_parts(effect.elements)},
                    {"legs", describe_parts(effect.legs)},
                    {"joints", describe_parts(effect.joints)}});
  }
  return list;
}

/// A number as people say it.
std::string describe_rounded(double value, const std::string& unit = "") {
  return describe_number(value, 4) + (unit.empty() ? "" : " " + unit);
}

/// A damping ratio only where something oscillates and dies out: elsewhere it would mislead.
json describe_mode(const Mode& mode) {
  json row = {{"frequency_rad_s", mode.frequency}};
  if (mode.frequency == 0.0) {
    row["motion"] = "free, no force opposes it";
  } else if (mode.growth > 0.0) {
    row["motion"] = "unstable, grows with " + describe_rounded(mode.growth, "1/s");
  } else if (mode.oscillates) {
    row["damping_ratio"] = mode.damping();
    row["motion"] = "oscillates";
  } else {
    row["motion"] = "dies out without oscillation";
  }
  return row;
}

/// Play of the seated rings, and what is wrong with it; null without rings or latches.
/// @param G  axes of the active ring at home, in those of its base
json describe_seated_play(const Capture& capture, const Mat3<double>& G, json& warnings) {
  if (!capture.contact.rings || capture.latches.count() == 0) return {};
  const SeatedPlay play = find_seated_play(capture.contact, capture.latches);
  if (play.overlap > 0.0) {
    warnings.push_back("the rings cannot seat: when their faces meet, petals are " +
                       describe_rounded(1e3 * play.overlap, "mm") +
                       " deep in each other or in a ring");
    return {};
  }
  // Docked, the axes of P are those of A.
  const double turn = std::atan2(-G(1, 2), G(1, 1));
  if (!(-turn >= play.least_roll && -turn <= play.most_roll)) {
    warnings.push_back(
        "at home the ring is turned by " + describe_rounded(turn / kDegree, "deg") +
        " about x, but petals have a play of " + describe_rounded(play.least_roll / kDegree) +
        " to " + describe_rounded(play.most_roll / kDegree, "deg") +
        ": petals of a target that is not turned meet petals; turn the joint of the ring, or, "
        "where the base is turned against the vehicle, disregard this");
  }
  const double catch_distance = capture.latches.latch[0].law.catch_distance;
  if (play.striker_opening > catch_distance) {
    warnings.push_back(
        "seated, a striker stands " + describe_rounded(1e3 * play.striker_opening, "mm") +
        " before its hook, but latches.catch is " + describe_rounded(1e3 * catch_distance, "mm") +
        ": latches catch only while contact is pressed that deep; move the hooks or "
        "let the latches catch earlier");
  }
  const double window = capture.latches.latch[0].law.window;
  if (play.striker_offset > window) {
    warnings.push_back(
        "seated, a striker can stand up to " + describe_rounded(1e3 * play.striker_offset, "mm") +
        " next to its hook, but latches.window is " + describe_rounded(1e3 * window, "mm") +
        ": rings can sit there and not be caught; give the petals less play or the "
        "latches a wider window");
  }
  return {{"roll_deg", {play.least_roll / kDegree, play.most_roll / kDegree}},
          {"lateral_mm", {1e3 * play.least_lateral, 1e3 * play.most_lateral}},
          {"striker_offset_mm", 1e3 * play.striker_offset},
          {"latch_window_mm", 1e3 * window}};
}

/// Refuses a bad sequence; which hardware its actions find is known with a scene only.
void check_sequence(const std::string& text, const std::string& source_name,
                    const MechanismModel& model) {
  const json document = parse_json(text, source_name);
  const JsonReader file(document, source_name);
  read_sequence(file.has("mechanism") ? file.at("mechanism") : file, model, nullptr, ContactModel(),
                HardDock());
}

}  // namespace

json check_mechanism_file(const std::string& text, const std::string& source_name) {
  Mechanism mechanism(read_mechanism(text, source_name));
  check_sequence(text, source_name, mechanism.model);
  close_home(mechanism, source_name);
  const MechanismModel& model = mechanism.model;
  MechanismData<double> data(mechanism);
  calc_position(mechanism, data);  // closed already

  json result;
  result["name"] = model.name;
  result["bodies"] = model.bodies.size();
  result["tree_velocities"] = model.nv;
  result["degrees_of_freedom"] = mechanism.plan.ind_v.size();
  json independent = json::array();
  for (int i : mechanism.plan.ind_bodies) independent.push_back(model.bodies[i].name);
  result["independent"] = independent;
  json loops = json::array(), order = json::array();
  for (size_t b = 0; b < mechanism.plan.blocks.size(); ++b) {
    const LoopBlock& block = mechanism.plan.blocks[b];
    json names = json::array();
    for (int k : block.loops) {
      const Loop& loop = model.loops[k];
      names.push_back(loop.name);
      loops.push_back(
          {{"name", loop.name},
           {"cut", describe_cut(loop.cut)},
           {"closure", describe_solution(block)},
           {"block", b + 1},
           {"size", mechanism.plan.loop_size[k]},
           {"gap",
            data.loops.cut[k].residual.head(equation_count(loop.cut)).lpNorm<Eigen::Infinity>()},
           {"margin", data.loops.block[b].margin}});
      if (!block.form() && !block.is_coupling) loops.back()["why_newton"] = block.closure.reason;
    }
    order.push_back(names);
  }
  for (size_t k = 0; k < model.loops.size(); ++k) {
    if (mechanism.plan.block_of_loop[k] >= 0) continue;
    loops.push_back({{"name", model.loops[k].name},
                     {"cut", describe_cut(model.loops[k].cut)},
                     {"closure", "redundant"},
                     {"gap", data.loops.cut[k]
                                 .residual.head(equation_count(model.loops[k].cut))
                                 .lpNorm<Eigen::Infinity>()}});
  }
  result["loops"] = loops;
  result["order"] = order;
  result["closure_residual"] = find_closure_residual(mechanism, data);
  result["singularity_margin"] = find_singularity_margin(mechanism, data);
  result["max_condition"] = find_max_condition(mechanism, data);
  result["home_q"] = model.home_q;
  double mass = 0.0;
  for (const Body& body : model.bodies) mass += body.mass;
  result["mass"] = mass;
  json warnings = json::array();
  if (find_singularity_margin(mechanism, data) < model.singularity.warning) {
    warnings.push_back("a loop is close to singular at home");
  }
  for (const std::string& note : mechanism.notes) warnings.push_back(note);
  for (const std::string& said : list_doubtful_inertias(model)) warnings.push_back(said);
  const Mat3<double> on_body = model.capture_in_body.R;
  const Mat3<double> G = model.capture_body == kBase
                             ? on_body
                             : Mat3<double>(data.tree.R[model.capture_body] * on_body);
  const json play = describe_seated_play(read_capture(text, source_name), G, warnings);
  if (!play.is_null()) result["seated_play"] = play;
  result["effects"] = describe_effects(mechanism);
  result["ranges"] = describe_ranges(mechanism);
  json modes = json::array();
  for (const Mode& mode : find_modes(mechanism)) modes.push_back(describe_mode(mode));
  result["modes"] = modes;
  result["warnings"] = warnings;
  return result;
}

json expand_mechanism(const std::string& text, const std::string& source_name) {
  const MechanismModel model = read_mechanism(text, source_name);
  const auto name_of = [&](int i) { return i == kBase ? "base" : model.bodies[i].name; };
  json bodies = json::array(), loops = json::array(), couplings = json::array();
  for (const Body& body : model.bodies) {
    json joint = {{"type", describe_joint(body.joint)},
                  {"position", to_json(body.placement.p)},
                  {"rotation", to_rows(body.placement.R)}};
    if (body.joint != JointType::kFree) joint["axis"] = to_json(body.axis);
    bodies.push_back({{"name", body.name},
                      {"parent", name_of(body.parent)},
                      {"joint", joint},
                      {"mass", body.mass},
                      {"com", to_json(body.com)},
                      {"inertia", to_rows(body.inertia)}});
  }
  for (const Loop& loop : model.loops) {
    if (loop.cut == CutType::kCoupling) {
      json terms = json::array();
      for (const CouplingTerm& term : loop.terms) {
        terms.push_back({{"joint", name_of(term.body)}, {"ratio", term.ratio}});
      }
      couplings.push_back({{"name", loop.name},
                           {"dependent", name_of(loop.terminal)},
                           {"terms", terms},
                           {"offset", loop.offset},
                           {"rate", loop.rate}});
      continue;
    }
    json cut = {{"type", describe_cut(loop.cut)},
                {"point_on_terminal", to_json(loop.point_on_terminal)},
                {"point_on_closing", to_json(loop.point_on_closing)}};
    if (loop.cut == CutType::kPlanarRevolute) {
      cut["plane_axes_in_root"] = to_rows(loop.plane_axes_in_root);
    } else if (loop.cut != CutType::kSpherical) {
      cut["axis_on_terminal"] = to_json(loop.axis_on_terminal);
      cut["axis_on_closing"] = to_json(loop.axis_on_closing);
    }
    json dependent = json::array();
    for (int i : loop.dependent) dependent.push_back(name_of(i));
    loops.push_back({{"name", loop.name},
                     {"root", name_of(loop.root)},
                     {"first", name_of(loop.first)},
                     {"terminal", name_of(loop.terminal)},
                     {"closing", name_of(loop.closing)},
                     {"dependent", dependent},
                     {"cut", cut}});
  }
  return {{"bodies", bodies},
          {"loops", loops},
          {"couplings", couplings},
          {"forces", describe_leg_forces(model)}};
}

json evaluate_states(const std::string& text, const std::string& source_name,
                     const std::string& states_text, const std::string& states_name,
                     bool newton_only) {
  Mechanism mechanism(read_mechanism(text, source_name), newton_only);
  close_home(mechanism, source_name);
  const MechanismModel& model = mechanism.model;
  const json document = parse_json(states_text, states_name);
  const JsonReader file(document, states_name);
  if (!file.has("states")) file.fail("lacks the member 'states'");
  json results = json::array();
  const std::vector<JsonReader> states = file.list("states");
  for (size_t n = 0; n < states.size(); ++n) {
    const JsonReader& state = states[n];
    MechanismData<double> data(mechanism);
    data.tree.time = state.number("time", 0.0);
    const std::vector<double> q = read_numbers(state, "q", model.nq);
    const Status status =
        move_to(mechanism, Eigen::Map<const VecX<double>>(q.data(), model.nq), data);
    if (!status.ok()) fail_state(states_name, n, mechanism, status);
    const std::vector<double> v =
        read_numbers(state, "v_independent", static_cast<int>(mechanism.plan.ind_v.size()));
    for (size_t i = 0; i < v.size(); ++i) data.tree.v[mechanism.plan.ind_v[i]] = v[i];
    BaseMotion<double> base;
    base.gravity = model.gravity;
    if (state.has("base_motion")) {
      const JsonReader motion = state.at("base_motion");
      base.w = motion.vector<3>("angular_velocity", base.w);
      base.alpha = motion.vector<3>("angular_acceleration", base.alpha);
      base.a = motion.vector<3>("linear_acceleration", base.a);
    }
    const std::vector<double> tau = read_numbers(state, "tau", model.nv);
    data.tau = Eigen::Map<const VecX<double>>(tau.data(), model.nv);
    for (const JsonReader& load : state.list("external")) {
      const int body = find_body(model, load.at("body").text(), load.path());
      if (body == kBase) load.fail("acts on the base, which does not move");
      data.tree.external[body].f += load.at("force").vector<3>();
      data.tree.external[body].t += load.vector<3>("moment", Vec3<double>::Zero());
    }
    calc_velocity(mechanism, base, data);
    calc_acceleration(mechanism, base, data);
    calc_reactions(mechanism, base, kBase, data);
    calc_joint_loads(mechanism, data);

    json out;
    out["q"] = to_json(data.tree.q);
    out["v"] = to_json(data.tree.v);
    out["a"] = to_json(data.vdot);
    json forces = json::object();
    for (size_t k = 0; k < model.loops.size(); ++k) {
      std::vector<double> force;
      for (int j = 0; j < equation_count(model.loops[k].cut); ++j) {
        force.push_back(get_cut_force(mechanism.plan, data.loops, static_cast<int>(k), j));
      }
      forces[model.loops[k].name] = force;
    }
    out["loop_force"] = forces;
    out["base_force"] = to_json(data.on_base.f);
    out["base_moment"] = to_json(data.on_base.t);
    json joints = json::object();
    for (size_t i = 0; i < model.bodies.size(); ++i) {
      const Wrench<double>& load = data.joint_load[i];
      joints[model.bodies[i].name] = {{"force", to_json(load.f)}, {"moment", to_json(load.t)}};
    }
    out["joint_load"] = joints;
    json inertia = json::array();
    for (int i = 0; i < data.A_ind.rows(); ++i) inertia.push_back(to_json(data.A_ind.row(i)));
    out["reduced_inertia"] = inertia;
    out["reduced_rhs"] = to_json(data.b_ind);
    out["max_condition"] = find_max_condition(mechanism, data);
    results.push_back(out);
  }
  return results;
}

}  // namespace dockloop
