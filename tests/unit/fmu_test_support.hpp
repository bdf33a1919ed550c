// What tests of the FMI functions share: a resource folder on disk, and a log without a reader.
// The functions themselves are compiled into fmu_functions_test.cpp.
#pragma once

#include <stdlib.h>

#include <filesystem>
#include <fstream>
#include <string>

#include "instance.hpp"
#include "sim/solver_methods.hpp"
#include "unit/minimal_scene.hpp"

namespace dockloop {

inline void ignore_log(fmi2ComponentEnvironment, fmi2String, fmi2Status, fmi2String, fmi2String,
                       ...) {}

/// GUID of the FMU of a scene document.
inline std::string find_guid(const std::string& document) {
  DockingSim sim(std::make_shared<const Scene>(read_scene(document, "scene")),
                 FmiKind::kCoSimulation, get_fmu_comparison());
  return find_guid(sim.scene(), make_variables(sim));
}

/// A folder `resources` with a scene; removed at the end.
class Resources {
 public:
  explicit Resources(const std::string& name = "resources",
                     const std::string& scene = minimal_scene_text()) {
    std::string pattern = (std::filesystem::temp_directory_path() / "dockloop-XXXXXX").string();
    root_ = mkdtemp(pattern.data());
    folder_ = root_ + "/" + name;
    std::filesystem::create_directories(folder_);
    std::ofstream(folder_ + "/model.json") << scene;
  }
  ~Resources() { std::filesystem::remove_all(root_); }
  Resources(const Resources&) = delete;
  Resources& operator=(const Resources&) = delete;
  const std::string& folder() const { return folder_; }
  std::string uri() const { return "file://" + folder_; }

 private:
  std::string root_, folder_;
};

}  // namespace dockloop
