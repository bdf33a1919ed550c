// Forces between the vehicles: tangent and checks; see vehicle_force.hpp.
#include "docking/vehicle_force.hpp"

#include "docking/vehicle_force_body.hpp"
#include "math/status.hpp"

namespace dockloop {
namespace {

constexpr double kLeastLine = 1e-9;  ///< a shorter line has the direction of rounding errors [m]

}  // namespace

ForceTable make_force_table(const std::vector<double>& gap, const std::vector<double>& offset,
                            const std::vector<std::vector<double>>& force) {
  ForceTable table;
  const size_t n = offset.size();
  for (const std::vector<double>& row : force) table.force.emplace_back(gap, row);
  for (double each : offset) table.square.push_back(each * each);
  table.slope.assign(n, std::vector<double>(n, 0.0));
  const auto length = [&](size_t i) { return table.square[i + 1] - table.square[i]; };
  if (n == 2) table.slope[0] = {-1.0 / length(0), 1.0 / length(0)};
  for (size_t i = 0; i + 2 < n; ++i) {
    const double h = length(i), k = length(i + 1), both = h + k;
    double* const here = &table.slope[i][i];
    double* const next = &table.slope[i + 1][i];
    if (i == 0) {
      here[0] = -1.0 / h - 1.0 / both;
      here[1] = both / (h * k);
      here[2] = -h / (k * both);
    }
    next[0] = -k / (h * both);
    next[1] = 1.0 / h - 1.0 / k;
    next[2] = h / (k * both);
  }
  return table;  // flat at the largest offset
}

void add_vehicle_force_tangent(const std::vector<VehicleForce>& forces,
                               const RelativeMotion<double>& motion, InterfaceTangent& tangent) {
  if (forces.empty()) return;
  constexpr int kColumns = 6;
  static_assert(kColumns <= kLanes);
  for (const bool by_velocity : {false, true}) {
    RelativeMotion<Derivative> seeded;
    seeded.R = cast<Derivative>(motion.R);
    seeded.p = cast<Derivative>(motion.p);
    seeded.w = cast<Derivative>(motion.w);
    seeded.v = cast<Derivative>(motion.v);
    for (int i = 0; i < 3; ++i) {
      (by_velocity ? seeded.v : seeded.p)[i].d[i] = 1.0;
      if (by_velocity) {
        seeded.w[i].d[3 + i] = 1.0;
        continue;
      }
      for (int j = 0; j < 3; ++j) {
        const Vec3<double> turned = Vec3<double>::Unit(i).cross(Vec3<double>(motion.R.col(j)));
        for (int k = 0; k < 3; ++k) seeded.R(k, j).d[3 + i] = turned[k];
      }
    }
    const Wrench<Derivative> load = sum_vehicle_forces<Derivative>(forces, seeded).on_passive;
    Mat6<double>& map = by_velocity ? tangent.damping : tangent.stiffness;
    for (int column = 0; column < kColumns; ++column) {
      for (int i = 0; i < 3; ++i) {
        map(i, column) += load.f[i].d[column];
        map(3 + i, column) += load.t[i].d[column];
      }
    }
  }
}

void make_forces_felt(std::vector<VehicleForce>& forces) {
  for (VehicleForce& force : forces) {
    if (force.kind == VehicleForce::Kind::kTether) force.kind = VehicleForce::Kind::kSpring;
    if (force.kind != VehicleForce::Kind::kTable) continue;
    force.kind = VehicleForce::Kind::kDipoles;
    force.size = 1.0;
    force.chaser_moment = force.target_moment = Vec3<double>(1e3, 2e3, 3e3);
  }
}

void check_vehicle_forces(const std::vector<VehicleForce>& forces,
                          const RelativeMotion<double>* motion) {
  size_t number = 0;
  for (const VehicleForce& force : forces) {
    const std::string name = "force[" + std::to_string(++number) + "]";
    for_each_force_number(
        force, name + ".",
        [](const std::string& member, double value, const char*, Rule rule, const std::string&) {
          const std::string why = find_fault(value, rule);
          if (why.empty()) return;
          throw ModelError(member + " is " + describe_number(value) + "; " + why);
        });
    if (force.kind == VehicleForce::Kind::kDipoles) {
      for (const auto& [member, moment] : {std::pair{".chaser_moment", &force.chaser_moment},
                                           std::pair{".target_moment", &force.target_moment}}) {
        if (!moment->isZero(0.0)) continue;
        throw ModelError(name + member + " is 0 A m2; a magnet needs a moment that is not zero");
      }
    }
    const bool has_direction = force.free_length > 0.0 || force.damping > 0.0;
    if (!motion || force.kind != VehicleForce::Kind::kSpring || !has_direction) continue;
    if (!(find_distance(force, *motion) > kLeastLine)) {
      throw ModelError("start state: the points of " + name +
                       " coincide, so the spring has no direction; move chaser_point or "
                       "target_point, or set free_length and damping to 0");
    }
  }
}

}  // namespace dockloop
