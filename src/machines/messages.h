// What machines say to each other. How that lies in bytes, and what is done with bytes that are no
// message: message_bytes.h.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "src/machines/message_bytes.h"
#include "src/machines/page_homes.h"
#include "src/session/shot_photons.h"

namespace trex::machines {

template <>
inline constexpr bool kIsBytes<shaderio::PhotonRecord> = true;
template <>
inline constexpr bool kIsBytes<PhotonLesson> = true;

enum class Kind : std::uint16_t {
  // To machine 0, but for kFetch, which goes to those that pass pages on, too:
  kHello = 1,  ///< the first: who I am
  kReady,      ///< the model is open
  kSet,        ///< the view is set up
  kResult,     ///< samples of a job
  kFetch,      ///< parts of files are wanted; to any machine that serves some
  kAtPhotons,  ///< a batch of photons is wanted
  kShot,       ///< some photons of it
  kProbed,     ///< the bytes of kProbe are here
  kPong,
  kFailed,  ///< can't go on
  kBye,     ///< the last
  // From machine 0, but for kPart, which answers kFetch:
  kWelcome,  ///< what there is to open
  kView,     ///< another picture begins
  kLight,    ///< photons will be read soon
  kPass,     ///< samples are going to be taken
  kRest,     ///< jobs that were given out are void
  kJob,
  kPart,     ///< parts of files
  kShoot,    ///< some photons of a batch are to be shot
  kPhotons,  ///< some that another machine has shot
  kAlone,    ///< shoot the batch alone: it is past
  kProbe,    ///< bytes whose way is measured
  kLink,     ///< what was measured
  kHomes,    ///< who passes pages on
  kPing,
  kStop,  ///< nothing more is wanted: kBye is
  kEnd,   ///< all have said goodbye that will
  // Of a window. To machine 0:
  kLit,     ///< the light is made
  kNoLoan,  ///< what was lent comes to nothing
  // From machine 0:
  kServe,  ///< what the window was started with; after kWelcome
  kEdit,   ///< another look, or another size: what was asked for before is void
  kAim,    ///< light that samples will read
  kLent,   ///< units of tiles to take
  // To whoever has sent kFetch:
  kNoPart,  ///< why there is no kPart
};
inline constexpr Kind kLastKind = Kind::kNoPart;

struct Hello {
  static constexpr Kind kKind = Kind::kHello;
  std::string version, host;
  std::uint64_t build = 0;         ///< hash of the program's file
  std::uint64_t instructions = 0;  ///< of the processor, as src/machines knows them
  std::uint32_t threads = 0;
  std::string model{};            ///< a bundle that it serves as file 0; empty: none
  std::uint64_t modelBytes = 0;   ///< of its file
  std::uint64_t modelDigest = 0;  ///< bundleDigest()
  template <class F>
  void fields(F&& f) {
    f(version), f(host), f(build), f(instructions), f(threads);
    f(model), f(modelBytes), f(modelDigest);
  }
};

struct Welcome {
  static constexpr Kind kKind = Kind::kWelcome;
  std::uint8_t local = 0;                ///< each machine has the model
  std::uint8_t baked = 0;                ///< the model is a bundle; else it was made for this
  std::vector<std::uint64_t> fileBytes;  ///< of files that kFetch names by their place here
  std::uint8_t window = 0;               ///< machine 0 has one: kServe follows
  std::uint32_t holder = 0;              ///< the machine that serves the first of these
  std::string model{};                   ///< its name there, if that is not machine 0
  template <class F>
  void fields(F&& f) {
    f(local), f(baked), f(fileBytes), f(window), f(holder), f(model);
  }
};

struct Ready {
  static constexpr Kind kKind = Kind::kReady;
  std::uint64_t digest = 0;   ///< of model, views and settings
  std::uint8_t passesOn = 0;  ///< it keeps packed pages for others
  template <class F>
  void fields(F&& f) {
    f(digest), f(passesOn);
  }
};

struct SetView {
  static constexpr Kind kKind = Kind::kView;
  std::uint32_t view = 0;
  template <class F>
  void fields(F&& f) {
    f(view);
  }
};

struct ViewSet {
  static constexpr Kind kKind = Kind::kSet;
  std::uint32_t view = 0;
  std::string device;
  template <class F>
  void fields(F&& f) {
    f(view), f(device);
  }
};

struct LightComes {
  static constexpr Kind kKind = Kind::kLight;
  std::uint32_t view = 0;
  std::uint64_t photons = 0;
  template <class F>
  void fields(F&& f) {
    f(view), f(photons);
  }
};

struct Pass {
  static constexpr Kind kKind = Kind::kPass;
  std::uint32_t view = 0, number = 0;
  std::uint64_t photons = 0;   ///< whose light the samples read
  double coneShare = 0.0;      ///< Session::coneShare() of machine 0
  std::uint32_t contents = 0;  ///< of samples: sample_bytes.h
  std::vector<double> shares;  ///< of exact samples, by tile; none without a dial
  template <class F>
  void fields(F&& f) {
    f(view), f(number), f(photons), f(coneShare), f(contents), f(shares);
  }
};

struct GiveJob {
  static constexpr Kind kKind = Kind::kJob;
  std::uint32_t pass = 0, id = 0;
  std::uint64_t first = 0, end = 0;
  template <class F>
  void fields(F&& f) {
    f(pass), f(id), f(first), f(end);
  }
};

/// What a machine's threads did since it set up its view, seconds added up.
struct MachineTimes {
  double processor = 0.0;  ///< processorSeconds(), since the program began
  double photons = 0.0;    ///< of the machine: shooting, and waiting for what others shoot
  double waiting = 0.0, unpacking = 0.0, reading = 0.0;  ///< as PageTrafficReport
  std::uint64_t pageLoads = 0, pagesRestored = 0;        ///< the latter of the former
  /// Of packed pages: that plans loaded, of those that other machines have; that came from there;
  /// that were passed on.
  std::uint64_t plannedBytes = 0, receivedBytes = 0, passedBytes = 0;
  template <class F>
  void fields(F&& f) {
    f(processor), f(photons), f(waiting), f(unpacking), f(reading), f(pageLoads), f(pagesRestored);
    f(plannedBytes), f(receivedBytes), f(passedBytes);
  }
};

struct Result {
  static constexpr Kind kKind = Kind::kResult;
  std::uint32_t pass = 0, id = 0;
  double seconds = 0.0;
  std::uint64_t peakBytes = 0;  ///< resident, of the machine
  MachineTimes times{};
  std::uint64_t cRays = 0, shadowRays = 0, cones = 0, cacheReads = 0, exactPaths = 0,
                deviceCones = 0;
  std::string device{};  ///< it may have failed, and another gone on
  Bytes samples{};
  template <class F>
  void fields(F&& f) {
    f(pass), f(id), f(seconds), f(peakBytes);
    times.fields(f);
    f(cRays), f(shadowRays), f(cones), f(cacheReads), f(exactPaths), f(deviceCones);
    f(device), f(samples);
  }
};

/// A part of a file.
struct FileRange {
  std::uint64_t offset = 0;
  std::uint32_t file = 0, bytes = 0;
};

struct Fetch {
  static constexpr Kind kKind = Kind::kFetch;
  std::uint64_t number = 0;  ///< of the question
  std::vector<FileRange> ranges;
  template <class F>
  void fields(F&& f) {
    f(number), f(ranges);
  }
};

/// All ranges of a question, one after the other. Written by PageServer, where they are read; its
/// bytes are those of the message, which goes once it was heard.
struct Part {
  static constexpr Kind kKind = Kind::kPart;
  std::uint64_t number = 0;
  ByteView bytes;
  template <class F>
  void fields(F&& f) {
    f(number), f(bytes);
  }
};

struct NoPart {
  static constexpr Kind kKind = Kind::kNoPart;
  std::uint64_t number = 0;  ///< of the question
  std::int32_t code = 1;     ///< as Failed
  std::string text;
  template <class F>
  void fields(F&& f) {
    f(number), f(code), f(text);
  }
};

struct AtPhotons {
  static constexpr Kind kKind = Kind::kAtPhotons;
  std::uint32_t view = 0;
  std::uint64_t first = 0, end = 0;  ///< of the batch
  template <class F>
  void fields(F&& f) {
    f(view), f(first), f(end);
  }
};

struct ShootPhotons {
  static constexpr Kind kKind = Kind::kShoot;
  std::uint32_t view = 0, id = 0;
  std::uint64_t batch = 0;  ///< its first photon
  std::uint64_t first = 0, end = 0;
  template <class F>
  void fields(F&& f) {
    f(view), f(id), f(batch), f(first), f(end);
  }
};

/// Photons [first, end) of a batch.
template <Kind K>
struct SomePhotons {
  static constexpr Kind kKind = K;
  std::uint32_t view = 0, id = 0;  ///< id: of the job, of those that were shot
  std::uint64_t batch = 0, first = 0, end = 0;
  double seconds = 0.0;  ///< that they took
  ShotPhotons photons;
  template <class F>
  void fields(F&& f) {
    f(view), f(id), f(batch), f(first), f(end), f(seconds), f(photons.records), f(photons.turns),
        f(photons.lessons);
  }
};
using Shot = SomePhotons<Kind::kShot>;
using Photons = SomePhotons<Kind::kPhotons>;

struct ShootAlone {
  static constexpr Kind kKind = Kind::kAlone;
  std::uint32_t view = 0;
  std::uint64_t batch = 0;
  template <class F>
  void fields(F&& f) {
    f(view), f(batch);
  }
};

struct Probe {
  static constexpr Kind kKind = Kind::kProbe;
  std::uint32_t number = 0;  ///< of the question
  Bytes bytes;
  template <class F>
  void fields(F&& f) {
    f(number), f(bytes);
  }
};

struct Probed {
  static constexpr Kind kKind = Kind::kProbed;
  std::uint32_t number = 0;
  template <class F>
  void fields(F&& f) {
    f(number);
  }
};

struct LinkFound {
  static constexpr Kind kKind = Kind::kLink;
  double roundTrip = 0.0, bandwidth = 0.0;  ///< as LinkSpeed
  template <class F>
  void fields(F&& f) {
    f(roundTrip), f(bandwidth);
  }
};

struct Homes {
  static constexpr Kind kKind = Kind::kHomes;
  std::vector<PageHome> machines;
  template <class F>
  void fields(F&& f) {
    f(machines);
  }
};

struct Failed {
  static constexpr Kind kKind = Kind::kFailed;
  std::int32_t code = 1;
  std::string text;
  template <class F>
  void fields(F&& f) {
    f(code), f(text);
  }
};

/// A message of a kind that says nothing more.
template <Kind K>
struct Word {
  static constexpr Kind kKind = K;
  template <class F>
  void fields(F&&) {}
};
using Ping = Word<Kind::kPing>;
using Pong = Word<Kind::kPong>;
using Bye = Word<Kind::kBye>;
using Rest = Word<Kind::kRest>;
using Stop = Word<Kind::kStop>;
using End = Word<Kind::kEnd>;

}  // namespace trex::machines
