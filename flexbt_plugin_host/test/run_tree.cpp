// SPDX-License-Identifier: BSD-3-Clause
// Runs trees in BehaviorTree.CPP's own executor, with the nodes of a library, for a comparison:
//
//     run_tree LIBRARY
//
// Each line of the input is a case, {"xml": text, "bb": {key: value}, "ops": [["tick"], ["once"], ["halt"],
// ["set", key, type, value], ...]}; each line of the output has the statuses of the root and of all nodes after each
// operation, [[root, [node, ...]], ...], up to the first error, null. With ["time", n] in its place, n ticks are timed:
// s for each.

#include <iostream>

#include "behaviortree_cpp/bt_factory.h"
#include "behaviortree_cpp/json_export.h"

using nlohmann::json;

namespace
{
void set(BT::Blackboard & board, const std::string & key, const json & value)
{
  if (value.is_boolean()) {
    board.set(key, value.get<bool>());
  } else if (value.is_number_integer()) {
    board.set(key, value.get<int>());
  } else if (value.is_number()) {
    board.set(key, value.get<double>());
  } else {
    board.set(key, value.get<std::string>());
  }
}

json run(BT::BehaviorTreeFactory & factory, const json & one)
{
  json steps = json::array();
  const auto board = BT::Blackboard::create();
  for (const auto & [key, value] : one["bb"].items()) {
    set(*board, key, value);
  }
  try {
    factory.clearRegisteredBehaviorTrees();
    factory.registerBehaviorTreeFromText(one["xml"]);
    auto tree = factory.createTree("Main", board);
    for (const json & op : one["ops"]) {
      auto status = BT::NodeStatus::IDLE;
      if (op[0] == "set") {
        set(*board, op[1], op[3]);
      } else if (op[0] == "halt") {
        tree.haltTree();
      } else if (op[0] == "time") {
        const auto begin = std::chrono::steady_clock::now();
        for (int tick = 0; tick < op[1]; ++tick) {
          tree.tickExactlyOnce();
        }
        const std::chrono::duration<double> seconds = std::chrono::steady_clock::now() - begin;
        steps.push_back(seconds.count() / op[1].get<int>());
        continue;
      } else {
        status = op[0] == "once" ? tree.tickOnce() : tree.tickExactlyOnce();
      }
      json nodes = json::array();
      tree.applyVisitor([&](const BT::TreeNode * node) { nodes.push_back(BT::toStr(node->status())); });
      steps.push_back({BT::toStr(status), nodes});
    }
  } catch (const std::exception &) {
    steps.push_back(nullptr);
  }
  return steps;
}
}  // namespace

int main(int, char ** argv)
{
  BT::BehaviorTreeFactory factory;
  factory.registerFromPlugin(argv[1]);
  for (std::string line; std::getline(std::cin, line);) {
    std::cout << run(factory, json::parse(line)).dump() << std::endl;
  }
}
