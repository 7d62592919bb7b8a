/* What the programs of these tests that use Cyclone DDS share. */
#ifndef TACTUS_TESTS_INTEROP_CYCLONE_PROGRAM_H
#define TACTUS_TESTS_INTEROP_CYCLONE_PROGRAM_H

#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <xxhash.h>

#include "dds/dds.h"

static volatile sig_atomic_t stopped = 0;

static void stop(int signal) {
  (void)signal;
  stopped = 1;
}

static uint64_t id_of(const char* name) { return XXH3_64bits(name, strlen(name)); }

static int64_t now_ns(clockid_t clock) {
  struct timespec t;
  clock_gettime(clock, &t);
  return (int64_t)t.tv_sec * 1000000000 + t.tv_nsec;
}

static dds_entity_t checked(const char* what, dds_entity_t made) {
  if (made >= 0) return made;
  fprintf(stderr, "%s: %s\n", what, dds_strretcode(-made));
  exit(2);
}

#endif
