#include "spm/ids.hpp"

#include <gtest/gtest.h>

#include <type_traits>

#include "spm/ab_tree.hpp"
#include "spm/cache.hpp"
#include "spm/forest.hpp"
#include "spm/pool.hpp"
#include "spm/record.hpp"

namespace tactus::spm {
namespace {

// Compile-time tests: no index type converts to another, and each store or function takes only its own index type.

template <class... Ids>
constexpr bool are_distinct_index_types() {
  const auto is_distinct = []<class Id>(std::type_identity<Id>) {
    return Index<Id> && !std::is_convertible_v<Id, std::uint32_t> && !std::is_convertible_v<std::uint32_t, Id> &&
           ((std::is_same_v<Id, Ids> || !(std::is_convertible_v<Ids, Id> || std::is_constructible_v<Id, Ids>)) && ...);
  };
  return (is_distinct(std::type_identity<Ids>{}) && ...);
}
static_assert(are_distinct_index_types<VertexId, FaceId, RecordId, PartIndex, RegionId, ObjectIndex, Slot, RowIndex,
                                       BlockIndex, NodeIndex>());

template <class Store, class Id>
concept SubscriptedBy = requires(Store store, Id id) {
  store[id];
};
template <class Store, class Own, class... Others>
constexpr bool takes_only() {
  return SubscriptedBy<Store, Own> && !SubscriptedBy<Store, std::uint32_t> && !(SubscriptedBy<Store, Others> || ...);
}
static_assert(takes_only<decltype(Pool::parts), Slot, RowIndex, VertexId, RecordId, PartIndex>());
static_assert(takes_only<decltype(Pool::vertices), Slot, RowIndex, VertexId>());
static_assert(takes_only<decltype(Pool::shown_at), RowIndex, Slot, FaceId, NodeIndex>());
static_assert(takes_only<decltype(Pool::blocks), BlockIndex, Slot, RowIndex>());
static_assert(takes_only<decltype(Model::parts), PartIndex, RecordId, Slot>());
static_assert(takes_only<NodePool, NodeIndex, RowIndex, Slot, FaceId>());

static_assert(std::is_invocable_v<decltype(&AbTree::remove), AbTree&, RowIndex>);
static_assert(!std::is_invocable_v<decltype(&AbTree::remove), AbTree&, Slot>);
static_assert(!std::is_invocable_v<decltype(&AbTree::remove), AbTree&, FaceId>);
static_assert(!std::is_invocable_v<decltype(&Forest::retire), Forest&, RecordId>);
static_assert(!std::is_invocable_v<decltype(&Forest::hash_of), RecordId>);
static_assert(!std::is_invocable_v<decltype(&Cache::has_record), const Cache&, ObjectIndex, VertexId>);
static_assert(!std::is_invocable_v<decltype(&Cache::has_record), const Cache&, RegionId, RecordId>);
static_assert(!std::is_invocable_v<decltype(&BornRef::make), VertexId, std::uint32_t, bool>);
static_assert(!std::is_invocable_v<decltype(&LoadedPart::DeformedRef::make), FaceId, std::uint32_t, bool>);

TEST(Ids, NoneDiffersFromEveryIndexOfEveryType) {
  EXPECT_EQ(Slot{kNone}, kNone);
  EXPECT_NE(Slot{0}, kNone);
  EXPECT_EQ(std::uint32_t{kNone}, index(FaceId{kNone}));
}

TEST(Ids, ARangeOfIdsHasEveryIndexOnceInOrder) {
  IdVector<RegionId, int> counts{3};
  std::uint32_t expected = 0;
  for (const RegionId region : counts.ids()) {
    EXPECT_EQ(index(region), expected++);
    ++counts[region];
  }
  EXPECT_EQ(counts.values(), (std::vector<int>{1, 1, 1}));
}

}  // namespace
}  // namespace tactus::spm
