// Entries of a whole work group, appended by one atomic: cards take those of one address in turn. A
// processor does not, and barriers cost it more.

#constant SOFTWARE  // 1: a processor draws

#include "lists.glsl"

shared uint group_some, group_first;

// Takes places for the `some` entries of each invocation, and says which is its first. All of a work
// group must call it.
uint places_of_group(uint some, uint list, uint per_group) {
#if SOFTWARE
    return some > 0u ? places_for(some, list, per_group) : 0u;
#else
    bool is_first = gl_LocalInvocationIndex == 0u;
    if (is_first) group_some = 0u;
    barrier();
    uint own = some > 0u ? atomicAdd(group_some, some) : 0u;
    barrier();
    if (is_first && group_some > 0u) group_first = places_for(group_some, list, per_group);
    barrier();
    return group_first + own;
#endif
}
