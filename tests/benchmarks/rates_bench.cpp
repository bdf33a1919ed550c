// What one right-hand side of a docking costs, whole and phase by phase, with Google Benchmark.
//
//   rates_bench MODEL.json[,KERNEL.so]... [--benchmark_... options]
//
// MODEL.json is resources/model.json of an FMU. The scene is evaluated at its level (model.level),
// at its start state and, where it has contact, with the capture surfaces 1 mm into each other.
// Names: SCENE/CODE/WHAT, CODE as in mechanism_bench.
#include <benchmark/benchmark.h>

#include <cstdio>
#include <deque>
#include <fstream>
#include <sstream>
#include <vector>

#include "benchmarks/mechanism_evaluation.hpp"
#include "docking/docking_jacobian.hpp"

namespace {

using namespace dockloop;

std::string read_file(const std::string& name) {
  std::ifstream file(name);
  if (!file) throw ModelError("cannot read " + name);
  std::stringstream text;
  text << file.rdbuf();
  return text.str();
}

std::string find_name(const std::string& file) {  // FOLDER/SCENE/resources/model.json
  std::string folder = file.substr(0, file.rfind("/resources"));
  return folder.substr(folder.rfind('/') + 1);
}

class Docking {
 public:
  explicit Docking(const std::string& file)
      : scene_(read_scene(read_file(file), file)),
        model_(make_docking_model(scene_, scene_.vehicle, scene_.contact.law,
                                  scene_.vehicle[kChaser].position, scene_.level)),
        data_(model_),
        y_(static_cast<size_t>(model_.layout.size), 0.0),
        ydot_(y_) {
    int q = model_.layout.mechanism_q, v = model_.layout.mechanism_v;
    for (int i : model_.mechanism_bodies) {
      const Body& body = model_.mechanism.model.bodies[i];
      for (int j = 0; j < body.nq(); ++j) {
        y_[q++] = model_.mechanism.model.home_q[body.q_index + j];
      }
      for (int j = 0; j < body.nv(); ++j) y_[v++] = 0.01 * (j + 1);
    }
    for (int i : {kChaser, kTarget}) {
      if (model_.layout.pose[i] < 0) continue;
      const Vec3<double> x = scene_.vehicle[i].position - scene_.vehicle[kChaser].position;
      for (int j = 0; j < 3; ++j) y_[model_.layout.pose[i] + j] = x[j];
      for (int j = 0; j < 4; ++j) {
        y_[model_.layout.pose[i] + 3 + j] = scene_.vehicle[i].attitude[j];
      }
    }
    loads_.command.setZero(static_cast<int>(model_.mechanism.model.forces.size()));
    if (!rates().ok()) throw ModelError(file + ": the start state cannot be evaluated");
    if (scene_.level == kRigid) lock_mechanism(model_, data_, locked_);
    touching_ = y_;
    has_contact_ = model_.present[kTarget] && !model_.contact.empty();
    if (!has_contact_) return;
    // Surfaces that are far apart sleep until they could meet.
    update_contact_memory(model_.contact, data_.relative, nullptr, data_.contact_work, asleep_);
    // Bring them together along the docking axis; the gap is a lower bound of the way.
    const Vec3<double> axis = data_.interface[kTarget].R.col(0);
    for (double gap = 1.0; gap > -kDepth + 1e-5;) {
      if (!evaluate(touching_, awake_).ok()) throw ModelError(file + ": contact is too deep");
      gap = find_gap(model_.contact, data_.relative, data_.contact_work);
      for (int j = 0; j < 3; ++j) {
        touching_[model_.layout.pose[kTarget] + j] -= (gap + kDepth) * axis[j];
      }
    }
    evaluate(touching_, awake_);
    update_contact_memory(model_.contact, data_.relative, nullptr, data_.contact_work, closed_);
  }

  const Mechanism& mechanism() const { return model_.mechanism; }

  /// Evaluate by a kernel from now on. @return whether it takes the start state
  bool use(const std::shared_ptr<MechanismKernel>& kernel) {
    rates();
    keep_reference(model_.mechanism, data_.mechanism);
    data_.mechanism.generated = kernel;
    rates();
    return data_.mechanism.found == Need::kRates;
  }

  void add_benchmarks(const std::string& name) {
    MechanismData<double>& mechanism = data_.mechanism;
    add(name + "/1 whole", [this] { rates(); });
    if (!data_.locked) {
      add(name + "/2 position",
          [this, &mechanism] { calc_position(model_.mechanism, mechanism, Need::kRates); });
      add(name + "/3 velocity",
          [this, &mechanism] { calc_velocity(model_.mechanism, data_.base, mechanism); });
      add(name + "/6 acceleration",
          [this, &mechanism] { calc_acceleration(model_.mechanism, data_.base, mechanism); });
    }
    add(name + "/4 frames", [this] { calc_frames(model_, y_.data(), data_); });
    add(name + "/5 loads", [this] {
      calc_loads(model_, discrete_, asleep_, loads_, 0.0, y_.data(), ydot_.data(), data_);
    });
    add(name + "/7 rates of vehicles and sums",
        [this] { calc_vehicle_rates(model_, loads_, y_.data(), ydot_.data(), data_); });
    if (has_contact_) {
      add(name + "/8 whole, surfaces near", [this] { evaluate(y_, awake_); });
      add(name + "/9 whole, in contact", [this] { evaluate(touching_, closed_); });
    }
    if (!data_.mechanism.generated) {
      pass_.emplace(model_);
      add(name + "/eight derivatives", [this] {
        start_docking_pass(model_, loads_, 0.0, y_.data(), *pass_);
        for (int lane = 0; lane < kLanes; ++lane) pass_->y[lane].d[lane] = 1.0;
        calc_docking_pass(model_, discrete_, asleep_, data_, *pass_);
      });
    }
  }

 private:
  Status evaluate(const std::vector<double>& y, const ContactMemory& memory) {
    return calc_docking<double>(model_, discrete_, memory, loads_, 0.0, y.data(), ydot_.data(),
                                data_, Need::kRates);
  }
  Status rates() { return evaluate(y_, asleep_); }

  /// Register work(), timed after the whole has been evaluated at the start state.
  template <class Work>
  void add(const std::string& name, Work work) {
    benchmark::RegisterBenchmark(name.c_str(), [this, work](benchmark::State& state) {
      rates();
      for ([[maybe_unused]] auto _ : state) {
        work();
        benchmark::ClobberMemory();
      }
    });
  }
  static constexpr double kDepth = 1e-3;  // [m]
  Scene scene_;
  DockingModel model_;
  DockingData<double> data_;
  LockedMechanism locked_;  ///< at model.level 1
  DiscreteState discrete_;
  ContactMemory awake_, asleep_, closed_;  ///< knows nothing; far apart; in contact
  Loads loads_;
  std::vector<double> y_, ydot_, touching_;
  std::optional<DockingPass> pass_;
  bool has_contact_ = false;
};

}  // namespace

int main(int argc, char** argv) {
  benchmark::Initialize(&argc, argv);
  if (argc < 2) {
    std::fprintf(stderr,
                 "usage: rates_bench MODEL.json[,KERNEL.so]... [--benchmark_... options]\n");
    return 2;
  }
  try {
    std::deque<Docking> dockings;  // addresses stay
    for (int i = 1; i < argc; ++i) {
      const Subject subject(argv[i]);
      const std::string name = "rates of " + find_name(subject.file);
      Docking& general = dockings.emplace_back(subject.file);
      general.add_benchmarks(name + "/general");
      for (const NamedKernel& kernel : find_kernels(general.mechanism(), subject.kernel_file)) {
        Docking& docking = dockings.emplace_back(subject.file);
        if (docking.use(kernel.kernel)) {
          docking.add_benchmarks(name + "/" + kernel.name);
        } else {
          std::fprintf(stderr, "the %s refuses the start of %s\n", kernel.name.c_str(),
                       name.c_str());
        }
      }
    }
    benchmark::RunSpecifiedBenchmarks();
  } catch (const std::exception& error) {
    std::fprintf(stderr, "rates_bench: %s\n", error.what());
    return 1;
  }
  return 0;
}
