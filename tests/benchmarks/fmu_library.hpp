// An unpacked FMU, driven through the C interface as any host would.
#pragma once

#include <dlfcn.h>
#include <fmi2Functions.h>

#include <fstream>
#include <iterator>
#include <regex>
#include <stdexcept>
#include <string>

namespace dockloop {

class FmuLibrary {
 public:
  /// @param folder  absolute; holds modelDescription.xml, binaries/, resources/
  /// @throws std::runtime_error if it cannot be loaded
  explicit FmuLibrary(const std::string& folder) : resources_("file://" + folder + "/resources") {
    std::ifstream file(folder + "/modelDescription.xml");
    xml_.assign(std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>());
    if (xml_.empty()) throw std::runtime_error("cannot read " + folder + "/modelDescription.xml");
    guid_ = attribute("<fmiModelDescription", "guid");
    const std::string path =
        folder + "/binaries/linux64/" + attribute("<CoSimulation", "modelIdentifier") + ".so";
    library_ = dlopen(path.c_str(), RTLD_NOW);
    if (!library_) throw std::runtime_error(dlerror());
    load("fmi2Instantiate", instantiate_);
    load("fmi2SetInteger", set_integer);
    load("fmi2SetReal", set_real);
    load("fmi2GetInteger", get_integer);
    load("fmi2GetReal", get_real);
    load("fmi2SetupExperiment", setup);
    load("fmi2EnterInitializationMode", enter);
    load("fmi2ExitInitializationMode", exit);
    load("fmi2DoStep", step);
    load("fmi2NewDiscreteStates", update);
    load("fmi2EnterContinuousTimeMode", enter_continuous);
    load("fmi2GetContinuousStates", get_states);
    load("fmi2SetContinuousStates", set_states);
    load("fmi2GetDerivatives", get_rates);
    load("fmi2FreeInstance", release);
  }

  fmi2Component instantiate(fmi2Type type = fmi2CoSimulation) const {
    static const fmi2CallbackFunctions callbacks{ignore_log, nullptr, nullptr, nullptr, nullptr};
    const fmi2Component c = instantiate_("benchmark", type, guid_.c_str(), resources_.c_str(),
                                         &callbacks, fmi2False, fmi2False);
    if (!c) throw std::runtime_error("fmi2Instantiate refused");
    return c;
  }

  /// From instantiated to its first step, at t = 0.
  void initialise(fmi2Component c) const {
    check(setup(c, fmi2False, 0.0, 0.0, fmi2False, 0.0));
    check(enter(c));
    check(exit(c));
  }

  static void check(fmi2Status status) {
    if (status != fmi2OK) throw std::runtime_error("a call was not answered with fmi2OK");
  }

  fmi2ValueReference reference(const std::string& variable) const {
    return static_cast<fmi2ValueReference>(
        std::stoul(attribute("name=\"" + variable + "\"", "valueReference")));
  }
  double experiment(const std::string& name) const {
    return std::stod(attribute("<DefaultExperiment", name));
  }
  const std::string& xml() const { return xml_; }

  fmi2SetIntegerTYPE* set_integer = nullptr;
  fmi2SetRealTYPE* set_real = nullptr;
  fmi2GetIntegerTYPE* get_integer = nullptr;
  fmi2GetRealTYPE* get_real = nullptr;
  fmi2SetupExperimentTYPE* setup = nullptr;
  fmi2EnterInitializationModeTYPE* enter = nullptr;
  fmi2ExitInitializationModeTYPE* exit = nullptr;
  fmi2DoStepTYPE* step = nullptr;
  fmi2NewDiscreteStatesTYPE* update = nullptr;
  fmi2EnterContinuousTimeModeTYPE* enter_continuous = nullptr;
  fmi2GetContinuousStatesTYPE* get_states = nullptr;
  fmi2SetContinuousStatesTYPE* set_states = nullptr;
  fmi2GetDerivativesTYPE* get_rates = nullptr;
  fmi2FreeInstanceTYPE* release = nullptr;

 private:
  static void ignore_log(fmi2ComponentEnvironment, fmi2String, fmi2Status, fmi2String, fmi2String,
                         ...) {}

  /// Value of an attribute that follows `after`.
  std::string attribute(const std::string& after, const std::string& name) const {
    const size_t from = xml_.find(after);
    std::smatch found;
    const std::string rest = from == std::string::npos ? "" : xml_.substr(from, 2000);
    if (!std::regex_search(rest, found, std::regex(name + "=\"([^\"]*)\""))) {
      throw std::runtime_error("no " + name + " of " + after);
    }
    return found[1];
  }
  template <class Function>
  void load(const char* name, Function*& function) {
    function = reinterpret_cast<Function*>(dlsym(library_, name));
    if (!function) throw std::runtime_error(std::string(name) + " is not in the library");
  }

  std::string xml_, guid_, resources_;
  void* library_ = nullptr;
  fmi2InstantiateTYPE* instantiate_ = nullptr;
};

}  // namespace dockloop
