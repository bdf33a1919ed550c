// A docking in a program of your own: set, stepped, saved, restored, read.
//
//   docking_program FILE.json [NAME VALUE]
//
// `dockloop build SCENE -o FILE.json` writes the file. NAME VALUE is a start value, such as
// friction.coefficient 0.2.
#include <cstdio>
#include <cstdlib>
#include <dockloop/docking.hpp>

namespace {

constexpr double kStep = 0.01, kLongest = 20.0, kAttenuation = 0.5;  // s

/// The peak load on the target from now on until the legs had some time to attenuate. @return N
double find_peak(dockloop::Docking& docking) {
  const double end = docking.time() + kAttenuation;
  while (docking.time() < end) docking.step(kStep);
  return docking.get("capture.peak.compression");
}

void run(const char* file, const char* name, const char* value) {
  dockloop::Docking docking(file);
  if (name) docking.set(name, std::atof(value));
  while (docking.get("captured") == 0.0 && docking.time() < kLongest) docking.step(kStep);
  const bool is_captured = docking.get("captured") != 0.0;
  std::printf("%s after %.17g s\n", is_captured ? "captured" : "not captured", docking.time());
  // A saved state goes on with the same bits, here and in another process.
  const std::vector<char> state = docking.save();
  const double peak = find_peak(docking);
  docking.restore(state);
  std::printf("peak compression %.17g N, again %.17g N\n", peak, find_peak(docking));
}

}  // namespace

int main(int count, char* words[]) {
  try {
    if (count != 2 && count != 4) throw dockloop::UsageError("usage: FILE.json [NAME VALUE]");
    run(words[1], count == 4 ? words[2] : nullptr, words[count - 1]);
  } catch (const std::runtime_error& error) {
    std::fprintf(stderr, "docking_program: %s\n", error.what());
    return 2;
  }
}
