// master.c for Windows, with what it needs next to the system's own C runtime, ucrtbase.dll: its
// start, and printf and scanf, which that library has under other names. The C runtime of the
// compiler is not linked: it would be compiled from its sources first, which takes minutes.
#include "master.c"

#include <stdarg.h>

int _configure_narrow_argv(int mode);
void __main(void) {}  // constructors of C++: there are none

void start(void) {
  _configure_narrow_argv(1);  // with wildcards left as they are
  exit(main(*__p___argc(), *__p___argv()));
}

int fprintf(FILE* file, const char* format, ...) {
  va_list values;
  va_start(values, format);
  const int count = __stdio_common_vfprintf(0, file, format, NULL, values);
  va_end(values);
  return count;
}

int printf(const char* format, ...) {
  va_list values;
  va_start(values, format);
  const int count = __stdio_common_vfprintf(0, stdout, format, NULL, values);
  va_end(values);
  return count;
}

int scanf(const char* format, ...) {
  va_list values;
  va_start(values, format);
  const int count = __stdio_common_vfscanf(0, stdin, format, NULL, values);
  va_end(values);
  return count;
}
