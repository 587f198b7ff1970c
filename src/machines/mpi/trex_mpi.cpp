// The one file that calls MPI.
#include "src/machines/mpi/trex_mpi.h"

#define OMPI_SKIP_MPICXX 1
#include <mpi.h>

#include <climits>

namespace trex {
namespace {

constexpr int kTag = 1;

char text_[MPI_MAX_ERROR_STRING + 1];
MPI_Message found_ = MPI_MESSAGE_NULL;
int foundBytes_ = 0;

const char* problem(int code) {
  if (code == MPI_SUCCESS) return nullptr;
  int length = 0;
  MPI_Error_string(code, text_, &length);
  text_[length] = '\0';
  return text_;
}

const char* start(int& rank, int& size) {
  int provided = 0;
  if (const char* text =
          problem(MPI_Init_thread(nullptr, nullptr, MPI_THREAD_FUNNELED, &provided))) {
    return text;
  }
  MPI_Comm_set_errhandler(MPI_COMM_WORLD, MPI_ERRORS_RETURN);
  MPI_Comm_rank(MPI_COMM_WORLD, &rank);
  return problem(MPI_Comm_size(MPI_COMM_WORLD, &size));
}

const char* send(int to, const void* bytes, std::uint64_t size, void*& request) {
  if (size > INT_MAX) return "the message is too long for MPI";
  auto* made = new MPI_Request;
  request = made;
  return problem(
      MPI_Isend(bytes, static_cast<int>(size), MPI_BYTE, to, kTag, MPI_COMM_WORLD, made));
}

const char* sent(void* request, bool& done) {
  auto* of = static_cast<MPI_Request*>(request);
  int flag = 0;
  const int code = MPI_Test(of, &flag, MPI_STATUS_IGNORE);
  done = flag != 0;
  if (done || code != MPI_SUCCESS) delete of;
  return problem(code);
}

const char* look(bool& found, int& from, std::uint64_t& size) {
  int flag = 0;
  MPI_Status status;
  const int code = MPI_Improbe(MPI_ANY_SOURCE, kTag, MPI_COMM_WORLD, &flag, &found_, &status);
  found = code == MPI_SUCCESS && flag != 0;
  if (!found) return problem(code);
  from = status.MPI_SOURCE;
  MPI_Get_count(&status, MPI_BYTE, &foundBytes_);
  size = static_cast<std::uint64_t>(foundBytes_);
  return nullptr;
}

const char* receive(void* to) {
  return problem(MPI_Mrecv(to, foundBytes_, MPI_BYTE, &found_, MPI_STATUS_IGNORE));
}

const char* finish() { return problem(MPI_Finalize()); }

void abort(int code) { MPI_Abort(MPI_COMM_WORLD, code); }

}  // namespace

const MpiFunctions* trexMpiFunctions() {
  static char version[MPI_MAX_LIBRARY_VERSION_STRING];
  int length = 0;
  MPI_Get_library_version(version, &length);
  static const MpiFunctions all{version, start, send, sent, look, receive, finish, abort};
  return &all;
}

}  // namespace trex
