#pragma once

namespace trex {

/// What main() of a program does: runs `program` and gives its exit code, or that of the error that
/// it threw, which is said. A file beyond the process's limit (SIGXFSZ) is an error of writing, and
/// so are results that stdout does not take (a full disk); who reads no more of them (a pipe into
/// head) does not end a render that goes on. Streams that are closed at the start are /dev/null, so
/// that no file of ours gets their numbers.
int runMain(int (*program)(int argc, char** argv), int argc, char** argv);

}  // namespace trex
