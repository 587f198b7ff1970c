// The one file that calls MPI.
#include "src/machines/mpi/trex_mpi.h"

#define OMPI_SKIP_MPICXX 1
#include <dlfcn.h>
#include <mpi.h>

#include <climits>
#include <cstdlib>
#include <cstring>
#include <vector>

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

// Open MPI 5's, which the headers of 4.1 do not know: user level failure mitigation (ULFM), of the
// MPI Forum's chapter on fault tolerance. Both versions have the same libmpi.so.40.
constexpr int kProcessFailed = 75, kProcessFailedPending = 76;
struct Ulfm {
  int (*acknowledge)(MPI_Comm) = nullptr;
  int (*acknowledged)(MPI_Comm, MPI_Group*) = nullptr;
  int (*shrink)(MPI_Comm, MPI_Comm*) = nullptr;
};
Ulfm ulfm_;
bool survives_ = false;
std::vector<bool> dead_;  // by rank
std::vector<int> news_;   // of these, not told yet

template <class F>
void find(F& function, const char* name) {
  function = reinterpret_cast<F>(dlsym(RTLD_DEFAULT, name));
}

void findUlfm() {
  const char* enabled = std::getenv("OMPI_MCA_mpi_ft_enable");  // mpirun's, by --with-ft
  if (enabled == nullptr || std::strcmp(enabled, "1") != 0) return;
  find(ulfm_.acknowledge, "MPIX_Comm_failure_ack");
  find(ulfm_.acknowledged, "MPIX_Comm_failure_get_acked");
  find(ulfm_.shrink, "MPIX_Comm_shrink");
  survives_ =
      ulfm_.acknowledge != nullptr && ulfm_.acknowledged != nullptr && ulfm_.shrink != nullptr;
}

/// Whether an error says that a process has died. Then it is known from here on which.
bool noticesDeath(int code) {
  if (code == MPI_SUCCESS || !survives_) return false;
  int kind = code;
  MPI_Error_class(code, &kind);
  if (kind != kProcessFailed && kind != kProcessFailedPending) return false;
  MPI_Group all = MPI_GROUP_NULL, gone = MPI_GROUP_NULL;
  ulfm_.acknowledge(MPI_COMM_WORLD);
  ulfm_.acknowledged(MPI_COMM_WORLD, &gone);
  MPI_Comm_group(MPI_COMM_WORLD, &all);
  int count = 0;
  MPI_Group_size(gone, &count);
  for (int i = 0; i < count; ++i) {
    int rank = MPI_UNDEFINED;
    MPI_Group_translate_ranks(gone, 1, &i, all, &rank);
    if (rank < 0 || rank >= static_cast<int>(dead_.size()) || dead_[rank]) continue;
    dead_[rank] = true;
    news_.push_back(rank);
  }
  MPI_Group_free(&gone);
  MPI_Group_free(&all);
  return true;
}

const char* start(int& rank, int& size) {
  int provided = 0;
  if (const char* text =
          problem(MPI_Init_thread(nullptr, nullptr, MPI_THREAD_FUNNELED, &provided))) {
    return text;
  }
  MPI_Comm_set_errhandler(MPI_COMM_WORLD, MPI_ERRORS_RETURN);
  MPI_Comm_rank(MPI_COMM_WORLD, &rank);
  const int code = MPI_Comm_size(MPI_COMM_WORLD, &size);
  if (code == MPI_SUCCESS) dead_.assign(static_cast<std::size_t>(size), false);
  findUlfm();
  return problem(code);
}

const char* send(int to, const void* bytes, std::uint64_t size, void*& request) {
  if (size > INT_MAX) return "the message is too long for MPI";
  request = nullptr;
  if (dead_[static_cast<std::size_t>(to)]) return nullptr;
  auto* made = new MPI_Request;
  const int code =
      MPI_Isend(bytes, static_cast<int>(size), MPI_BYTE, to, kTag, MPI_COMM_WORLD, made);
  if (code == MPI_SUCCESS) {
    request = made;
    return nullptr;
  }
  delete made;
  return noticesDeath(code) ? nullptr : problem(code);
}

const char* sent(void* request, bool& done) {
  auto* of = static_cast<MPI_Request*>(request);
  int flag = 0;
  done = true;
  if (of == nullptr) return nullptr;
  const int code = MPI_Test(of, &flag, MPI_STATUS_IGNORE);
  done = flag != 0 || code != MPI_SUCCESS;
  if (done) delete of;
  return noticesDeath(code) ? nullptr : problem(code);
}

const char* look(bool& found, int& from, std::uint64_t& size) {
  int flag = 0;
  MPI_Status status;
  const int code = MPI_Improbe(MPI_ANY_SOURCE, kTag, MPI_COMM_WORLD, &flag, &found_, &status);
  found = code == MPI_SUCCESS && flag != 0;
  if (!found) return noticesDeath(code) ? nullptr : problem(code);
  from = status.MPI_SOURCE;
  MPI_Get_count(&status, MPI_BYTE, &foundBytes_);
  size = static_cast<std::uint64_t>(foundBytes_);
  return nullptr;
}

const char* receive(void* to, void*& request) {
  auto* made = new MPI_Request(MPI_REQUEST_NULL);
  const int code = MPI_Imrecv(to, foundBytes_, MPI_BYTE, &found_, made);
  request = nullptr;
  if (code == MPI_SUCCESS) {
    request = made;
    return nullptr;
  }
  delete made;
  return noticesDeath(code) ? nullptr : problem(code);
}

const char* received(void* request, bool& done, bool& whole) {
  auto* of = static_cast<MPI_Request*>(request);
  int flag = 0;
  done = true;
  whole = false;
  if (of == nullptr) return nullptr;
  const int code = MPI_Test(of, &flag, MPI_STATUS_IGNORE);
  whole = code == MPI_SUCCESS && flag != 0;
  done = whole || code != MPI_SUCCESS;
  if (done) delete of;
  return noticesDeath(code) ? nullptr : problem(code);
}

int lost() {
  if (news_.empty()) return -1;
  const int rank = news_.back();
  news_.pop_back();
  return rank;
}

bool survives() { return survives_; }

/// Where all live it is MPI's own end. Where some do not, that would wait for them: whoever is left
/// meets, and MPI is left as it is.
const char* finish(bool& unclean) {
  unclean = false;
  if (!survives_) return problem(MPI_Finalize());
  MPI_Comm living = MPI_COMM_NULL;
  int left = 0;
  if (const char* text = problem(ulfm_.shrink(MPI_COMM_WORLD, &living))) return text;
  MPI_Comm_size(living, &left);
  unclean = left < static_cast<int>(dead_.size());
  const int code = MPI_Barrier(living);
  if (unclean) return problem(code);
  MPI_Comm_free(&living);
  return problem(MPI_Finalize());
}

void abort(int code) { MPI_Abort(MPI_COMM_WORLD, code); }

}  // namespace

const MpiFunctions* trexMpiFunctions() {
  static char version[MPI_MAX_LIBRARY_VERSION_STRING];
  int length = 0;
  MPI_Get_library_version(version, &length);
  static const MpiFunctions all{version,  start, send,     sent,   look, receive,
                                received, lost,  survives, finish, abort};
  return &all;
}

}  // namespace trex
