/// Replaces two functions that Fast DDS calls for each secured message, because they take exclusive locks that all
/// threads of the process share. Only wire/ and its tests include this header.
///
/// These are read-write locks of glibc, and a thread may wait for one in a loop. Under SCHED_FIFO it does not give its
/// processor up. If this occurs on all processors, the thread that has to release the lock cannot run for almost a
/// second, and no probe state passes.
///
///     AESGCMGMAC_Transform::compute_sessionkey   of Fast DDS: derives a session key by slow functions of OpenSSL.
///                                                Here: keys::session_key, which takes a sixth of the time.
///     RAND_bytes                                 of OpenSSL. Here: from the kernel (keys/message_crypto.hpp).
///
/// The loader prefers a function of a program to one of a shared library, so Fast DDS calls these.
/// Measured in docs/decisions/0058-messages-without-exclusive-locks.md.
#pragma once

namespace tactus::wire {

/// Returns whether this program has the functions that Fast DDS calls. It does not if this code is in a shared library.
/// Then a thread that handles secured messages must not use SCHED_FIFO. Threads: any. Cost: some microseconds.
[[nodiscard]] bool replaces_message_crypto() noexcept;

}  // namespace tactus::wire
