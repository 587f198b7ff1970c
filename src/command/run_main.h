#pragma once

namespace trex {

/// What main() of a program does: runs `program` and gives its exit code, or that of the error that
/// it threw, which is said. A file beyond the process's limit (SIGXFSZ) is an error of writing.
int runMain(int (*program)(int argc, char** argv), int argc, char** argv);

}  // namespace trex
