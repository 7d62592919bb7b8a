#include "spm/offline/parallel.hpp"

#include <atomic>
#include <exception>
#include <mutex>
#include <thread>

namespace tactus::spm::offline {

unsigned thread_count(unsigned threads) {
  return threads != 0 ? threads : std::max(1u, std::thread::hardware_concurrency());
}

void parallel_for(std::size_t count, unsigned threads,
                  const std::function<void(std::size_t item, unsigned worker)>& work) {
  std::atomic<std::size_t> next{0};
  std::mutex mutex;
  std::exception_ptr thrown;
  std::size_t thrown_at = count;
  const auto run = [&](unsigned worker) {
    for (std::size_t item = next++; item < count; item = next++) {
      try {
        work(item, worker);
      } catch (...) {
        next = count;
        const std::lock_guard<std::mutex> lock{mutex};
        if (item >= thrown_at) continue;
        thrown_at = item;
        thrown = std::current_exception();
      }
    }
  };
  std::vector<std::thread> helpers;
  const std::size_t workers = std::min<std::size_t>(thread_count(threads), count);
  for (unsigned worker = 1; worker < workers; ++worker) helpers.emplace_back(run, worker);
  run(0);
  for (std::thread& helper : helpers) helper.join();
  if (thrown) std::rethrow_exception(thrown);
}

void parallel_ranges(std::size_t count, std::size_t grain, unsigned threads,
                     const std::function<void(std::size_t first, std::size_t last)>& work) {
  parallel_for((count + grain - 1) / grain, threads,
               [&](std::size_t item, unsigned) { work(item * grain, std::min(count, (item + 1) * grain)); });
}

void parallel_groups(std::size_t count, std::size_t grain, unsigned threads,
                     const std::function<bool(std::size_t item)>& continues_group,
                     const std::function<void(std::size_t first, std::size_t last)>& work) {
  const auto begin = [&](std::size_t i) {
    while (i > 0 && i < count && continues_group(i)) ++i;
    return std::min(i, count);
  };
  parallel_ranges(count, grain, threads, [&](std::size_t first, std::size_t last) {
    first = begin(first);
    last = begin(last);
    if (first < last) work(first, last);
  });
}

void parallel_both(unsigned threads, const std::function<void()>& one, const std::function<void()>& other) {
  parallel_for(2, threads, [&](std::size_t item, unsigned) { item == 0 ? one() : other(); });
}

double parallel_sum(std::size_t count, unsigned threads, const std::function<double(std::size_t item)>& value) {
  constexpr std::size_t kAtOnce = std::size_t{1} << 20, kRange = std::size_t{1} << 14;
  std::vector<double> values(std::min(count, kAtOnce));
  double sum = 0;
  for (std::size_t done = 0; done < count; done += kAtOnce) {
    const std::size_t some = std::min(count - done, kAtOnce);
    parallel_ranges(some, kRange, threads, [&](std::size_t first, std::size_t last) {
      for (std::size_t i = first; i < last; ++i) values[i] = value(done + i);
    });
    for (std::size_t i = 0; i < some; ++i) sum += values[i];
  }
  return sum;
}

}  // namespace tactus::spm::offline
