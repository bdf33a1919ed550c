// Walks along each independent coordinate until a loop refuses; see reachable_range.hpp.
#include "check/reachable_range.hpp"

#include <algorithm>
#include <cmath>

#include "check/coordinate_effects.hpp"
#include "mechanism/element_forces.hpp"

namespace dockloop {
namespace {

/// Move one velocity coordinate of a body by s from home.
void set_coordinate(const Mechanism& mechanism, const Body& body, int k, double s,
                    VecX<double>& q) {
  for (size_t i = 0; i < mechanism.model.home_q.size(); ++i) {
    q[static_cast<int>(i)] = mechanism.model.home_q[i];
  }
  if (body.joint != JointType::kFree) {
    q[body.q_index] += s;
    return;
  }
  Vec3<double> direction = Vec3<double>::Zero();
  direction[k % 3] = s;
  const Vec4<double> quat = q.segment<4>(body.q_index + 3);
  if (k < 3) {
    q.segment<3>(body.q_index) += quat_to_matrix<double>(quat) * direction;
  } else {
    q.segment<4>(body.q_index + 3) = quat_multiply<double>(quat, quat_exp<double>(direction));
  }
}

/// A body whose joint is past an end stop, kBase if there is none.
int find_stopped_body(const MechanismModel& model, const VecX<double>& q) {
  for (const JointForce& force : model.forces) {
    if (!force.stops.present) continue;
    const double at = q[model.bodies[force.body].q_index];
    if (at < force.stops.lower || at > force.stops.upper) return force.body;
  }
  for (const ForceElement& element : model.elements) {
    const double at = find_coordinate<double>(model, element, q);
    for (const ForceLaw& law : element.laws) {
      const StopLaw* stop = std::get_if<StopLaw>(&law);
      if (stop && (at < stop->lower || at > stop->upper)) return element.along.front().body;
    }
  }
  return kBase;
}

/// Distance from home to the farthest end stop that depends on this joint alone, 0 without one.
double find_stop_distance(const MechanismModel& model, int body) {
  const double home = model.home_q[static_cast<size_t>(model.bodies[body].q_index)];
  double farthest = 0.0;
  const auto look_at = [&](double place) {
    if (std::isfinite(place)) farthest = std::max(farthest, std::abs(place - home));
  };
  for (const JointForce& force : model.forces) {
    if (force.body != body || !force.stops.present) continue;
    look_at(force.stops.lower);
    look_at(force.stops.upper);
  }
  for (const ForceElement& element : model.elements) {
    if (element.along.size() != 1 || element.along.front().body != body) continue;
    for (const ForceLaw& law : element.laws) {
      const StopLaw* stop = std::get_if<StopLaw>(&law);
      if (!stop) continue;
      look_at(stop->lower / element.along.front().ratio);
      look_at(stop->upper / element.along.front().ratio);
    }
  }
  return farthest;
}

/// Does a loop, other than a coupling, move with this velocity coordinate, be it through others?
bool moves_loop(const Mechanism& mechanism, int coordinate) {
  std::vector<int> moved{coordinate};
  const auto is_moved = [&](int i) {
    return std::find(moved.begin(), moved.end(), i) != moved.end();
  };
  for (const LoopBlock& block : mechanism.plan.blocks) {
    if (!std::any_of(block.low.begin(), block.low.end(), is_moved)) continue;
    if (!block.is_coupling) return true;
    moved.insert(moved.end(), block.dep.begin(), block.dep.end());
  }
  return false;
}

RangeEnd find_end(const Mechanism& mechanism, const Body& body, int k, double step, double limit) {
  MechanismData<double> data(mechanism);
  RangeEnd end;
  end.status = calc_position(mechanism, data);
  if (!end.status.ok()) return end;
  keep_reference(mechanism, data);
  const auto reach = [&](double s) -> Status {
    set_coordinate(mechanism, body, k, s, data.tree.q);
    const Status status = calc_position(mechanism, data);
    if (!status.ok()) return status;
    // A pose that was stepped over, straight on: the determinant shows it.
    for (size_t b = 0; b < data.loops.block.size(); ++b) {
      if (data.loops.block[b].sign == data.loops.reference.sign[b]) continue;
      return {StatusCode::kLoopSingular, mechanism.plan.blocks[b].loops[0], 0.0, 0.0};
    }
    return {};
  };
  constexpr double kSmallest = 1e-6;  // of a step
  constexpr int kHalvings = 40;
  double size = step;
  while (std::abs(end.value) < limit && std::abs(size) > kSmallest * std::abs(step)) {
    const Status status = reach(end.value + size);
    if (status.ok()) {
      const int stopped = find_stopped_body(mechanism.model, data.tree.q);
      if (end.stopped_body == kBase && stopped != kBase) {
        double free = end.value, past = end.value + size;
        for (int i = 0; i < kHalvings; ++i) {
          const double middle = (free + past) / 2.0;
          const bool is_free =
              reach(middle).ok() && find_stopped_body(mechanism.model, data.tree.q) == kBase;
          (is_free ? free : past) = middle;
        }
        reach(past);
        end.stopped_body = find_stopped_body(mechanism.model, data.tree.q);
        end.stop = past;
        reach(end.value + size);
      }
      end.value += size;
      keep_reference(mechanism, data);
      if (size != step) size *= 0.5;
    } else {
      end.status = status;
      size *= 0.5;
    }
  }
  if (std::abs(end.value) >= limit) {
    end.value = std::copysign(limit, step);
    end.status = Status();
  }
  return end;
}

}  // namespace

std::vector<CoordinateRange> find_reachable_ranges(const Mechanism& mechanism) {
  constexpr double kTurn = 6.28318530717958647692, kBeyond = 1.25;
  double length = 0.0;
  for (size_t k = 0; k < mechanism.model.loops.size(); ++k) {
    if (mechanism.model.loops[k].cut == CutType::kCoupling) continue;
    length = std::max(length, mechanism.plan.loop_size[k]);
  }
  std::vector<CoordinateRange> ranges;
  for (int i : mechanism.plan.ind_bodies) {
    const Body& body = mechanism.model.bodies[i];
    for (int k = 0; k < body.nv(); ++k) {
      const bool is_single = body.joint != JointType::kFree;
      const double stop = is_single ? find_stop_distance(mechanism.model, i) : 0.0;
      const bool has_loop = moves_loop(mechanism, body.v_index + k);
      if (stop == 0.0 && !has_loop) continue;
      CoordinateRange range;
      range.coordinate = find_coordinate_name(body, k);
      range.is_angle = is_angle(body, k);
      const double limit = !has_loop ? kBeyond * stop : range.is_angle ? kTurn : 2.0 * length;
      range.lower = find_end(mechanism, body, k, -limit / 400.0, limit);
      range.upper = find_end(mechanism, body, k, limit / 400.0, limit);
      ranges.push_back(range);
    }
  }
  return ranges;
}

}  // namespace dockloop
