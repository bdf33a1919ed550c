// A host in one page of C: loads the library of an FMU, runs it and prints its Real variables.
//
//   master LIBRARY RESOURCE_URI GUID STOP STEP
//
// reads value references from standard input and prints the value of each at the end of the run,
// one per line. Compiles for Linux and Windows, so that both libraries get the same calls. Exit
// status 0, or 1 after a line on standard error.
#include <stdio.h>
#include <stdlib.h>

#include "fmi2FunctionTypes.h"

#ifdef _WIN32
#include <windows.h>
static void* open_library(const char* path) { return (void*)LoadLibraryA(path); }
static void* find(void* library, const char* name) {
  return (void*)GetProcAddress((HMODULE)library, name);
}
#else
#include <dlfcn.h>
static void* open_library(const char* path) { return dlopen(path, RTLD_NOW | RTLD_LOCAL); }
static void* find(void* library, const char* name) { return dlsym(library, name); }
#endif

static void log_line(fmi2ComponentEnvironment host, fmi2String instance, fmi2Status status,
                     fmi2String category, fmi2String message, ...) {
  (void)host;
  fprintf(stderr, "%s [%s] %d: %s\n", instance, category, (int)status, message);
}

static void require(int done, const char* what) {
  if (done) return;
  fprintf(stderr, "master: %s failed\n", what);
  exit(1);
}

int main(int argc, char** argv) {
  require(argc == 6, "reading five arguments");
  void* library = open_library(argv[1]);
  require(library != NULL, "loading the library");
#define FUNCTION(name) \
  name##TYPE* name = (name##TYPE*)find(library, #name); \
  require(name != NULL, "finding " #name)
  FUNCTION(fmi2Instantiate);
  FUNCTION(fmi2SetupExperiment);
  FUNCTION(fmi2EnterInitializationMode);
  FUNCTION(fmi2ExitInitializationMode);
  FUNCTION(fmi2DoStep);
  FUNCTION(fmi2GetReal);
  FUNCTION(fmi2Terminate);
  FUNCTION(fmi2FreeInstance);

  const fmi2CallbackFunctions callbacks = {log_line, calloc, free, NULL, NULL};
  fmi2Component docking = fmi2Instantiate("docking", fmi2CoSimulation, argv[3], argv[2], &callbacks,
                                          fmi2False, fmi2False);
  require(docking != NULL, "fmi2Instantiate");
  const double stop = atof(argv[4]), step = atof(argv[5]);
  require(fmi2SetupExperiment(docking, fmi2False, 0.0, 0.0, fmi2True, stop) == fmi2OK, "set-up");
  require(fmi2EnterInitializationMode(docking) == fmi2OK, "fmi2EnterInitializationMode");
  require(fmi2ExitInitializationMode(docking) == fmi2OK, "fmi2ExitInitializationMode");
  const long steps = (long)(stop / step + 0.5);
  for (long i = 0; i < steps; ++i) {
    require(fmi2DoStep(docking, (double)i * step, step, fmi2True) <= fmi2Warning, "fmi2DoStep");
  }
  fmi2ValueReference reference;
  while (scanf("%u", &reference) == 1) {
    double value;
    require(fmi2GetReal(docking, &reference, 1, &value) <= fmi2Warning, "fmi2GetReal");
    printf("%.17g\n", value);
  }
  require(fmi2Terminate(docking) == fmi2OK, "fmi2Terminate");
  fmi2FreeInstance(docking);
  return 0;
}
