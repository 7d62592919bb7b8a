/// Gives up what a reader of foreign files does not need.
#pragma once

namespace tactus::spm::importer {

/// From now on, this process can compute, allocate memory, and use the descriptors that it has. The kernel refuses
/// everything else: opening files, sockets, other programs, threads, other processes. Memory is never executable. The
/// process ends when the thread that started it ends. Throws std::system_error if the kernel cannot do this.
/// Source: seccomp(2), libseccomp.
void confine();

}  // namespace tactus::spm::importer
