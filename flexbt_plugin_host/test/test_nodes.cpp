// SPDX-License-Identifier: BSD-3-Clause
// The nodes of the tests of bt_plugin_host: well-behaved and faulty ones, with ports of all types.

#include <unistd.h>

#include <cmath>
#include <csignal>
#include <cstdlib>
#include <thread>

#include "behaviortree_cpp/bt_factory.h"
#include "behaviortree_cpp/json_export.h"

// -- types of ports --------------------------------------------------------------------------------------------------

struct Point  // crosses as text
{
  double x;
  double y;
};

namespace BT
{
template <>
inline Point convertFromString(StringView text)
{
  const auto parts = splitString(text, ',');
  if (parts.size() != 2) {
    throw RuntimeError("a point has two numbers, as in 1,2");
  }
  return {convertFromString<double>(parts[0]), convertFromString<double>(parts[1])};
}
}  // namespace BT

struct Box  // crosses as JSON
{
  std::string name;
  std::vector<double> size;
};

BT_JSON_CONVERTER(Box, box)
{
  add_field("name", &box.name);
  add_field("size", &box.size);
}

// A type as rosidl makes it for the message geometry_msgs/Point; its JSON is that of the message.
namespace geometry_msgs::msg
{
template <class Allocator>
struct Point_
{
  double x = 0.0;
  double y = 0.0;
  double z = 0.0;
};
using Point = Point_<std::allocator<void>>;

BT_JSON_CONVERTER(Point, point)
{
  add_field("x", &point.x);
  add_field("y", &point.y);
  add_field("z", &point.z);
}
}  // namespace geometry_msgs::msg

struct Opaque  // does not cross
{
};

enum class Color : uint8_t { Red = 1, Green = 2 };

[[noreturn]] void hang()
{
  while (true) {
    pause();
  }
}

// -- leaves that play a script of statuses, a letter for each call ---------------------------------------------------

template <class Base>
class Scripted : public Base
{
public:
  using Base::Base;
  static BT::PortsList providedPorts() { return {BT::InputPort<std::string>("script", "S", "letters of statuses")}; }

protected:
  BT::NodeStatus next()
  {
    const auto script = Base::template getInput<std::string>("script").value();
    switch (script.at(calls_++ % script.size())) {
      case 'R': return BT::NodeStatus::RUNNING;
      case 'F': return BT::NodeStatus::FAILURE;
      case 'K': return BT::NodeStatus::SKIPPED;
      default: return BT::NodeStatus::SUCCESS;
    }
  }

private:
  size_t calls_ = 0;
};

class Act : public Scripted<BT::StatefulActionNode>
{
  using Scripted::Scripted;
  BT::NodeStatus onStart() override { return next(); }
  BT::NodeStatus onRunning() override { return next(); }
  void onHalted() override {}
};

class Sync : public Scripted<BT::SyncActionNode>
{
  using Scripted::Scripted;
  BT::NodeStatus tick() override { return next(); }
};

class Cond : public Scripted<BT::ConditionNode>
{
  using Scripted::Scripted;
  BT::NodeStatus tick() override { return next(); }
};

// -- ports -----------------------------------------------------------------------------------------------------------

template <class T>
class Echo : public BT::SyncActionNode
{
public:
  using SyncActionNode::SyncActionNode;
  static BT::PortsList providedPorts() { return {BT::InputPort<T>("in"), BT::OutputPort<T>("out")}; }

private:
  BT::NodeStatus tick() override
  {
    const auto value = getInput<T>("in");
    if (!value) {
      throw BT::RuntimeError(value.error());
    }
    setOutput("out", *value);
    return BT::NodeStatus::SUCCESS;
  }
};

class Norm : public BT::SyncActionNode  // of a point that is only read
{
public:
  using SyncActionNode::SyncActionNode;
  static BT::PortsList providedPorts() { return {BT::InputPort<Point>("point"), BT::OutputPort<double>("norm")}; }

private:
  BT::NodeStatus tick() override
  {
    const auto point = getInput<Point>("point");
    if (!point) {
      throw BT::RuntimeError(point.error());
    }
    setOutput("norm", std::hypot(point->x, point->y));
    return BT::NodeStatus::SUCCESS;
  }
};

class Grow : public BT::SyncActionNode  // changes an entry in place
{
public:
  using SyncActionNode::SyncActionNode;
  static BT::PortsList providedPorts() { return {BT::BidirectionalPort<Box>("box")}; }

private:
  BT::NodeStatus tick() override
  {
    if (auto box = getLockedPortContent("box")) {
      box->castPtr<Box>()->size.push_back(1.0);
    }
    return BT::NodeStatus::SUCCESS;
  }
};

class Keep : public BT::StatefulActionNode  // could change its entries, and does not
{
public:
  using StatefulActionNode::StatefulActionNode;
  static BT::PortsList providedPorts()
  {
    return {
      BT::InputPort<int>("in"), BT::OutputPort<int>("out"), BT::BidirectionalPort<geometry_msgs::msg::Point>("point")};
  }

private:
  BT::NodeStatus onStart() override { return BT::NodeStatus::RUNNING; }
  BT::NodeStatus onRunning() override { return BT::NodeStatus::RUNNING; }
  void onHalted() override {}
};

class Add : public BT::SyncActionNode  // two ports, which may lead to one entry
{
public:
  using SyncActionNode::SyncActionNode;
  static BT::PortsList providedPorts()
  {
    return {BT::InputPort<int>("a", 40, ""), BT::InputPort<int>("b", "{b}", ""), BT::OutputPort<int>("sum")};
  }

private:
  BT::NodeStatus tick() override
  {
    setOutput("sum", getInput<int>("a").value() + getInput<int>("b").value());
    return BT::NodeStatus::SUCCESS;
  }
};

// -- faults and threads ----------------------------------------------------------------------------------------------

class Faulty : public BT::StatefulActionNode  // as "how" says
{
public:
  Faulty(const std::string & name, const BT::NodeConfig & config) : StatefulActionNode(name, config)
  {
    if (name == "in_constructor") {
      throw std::runtime_error("no such device");
    }
  }

  static BT::PortsList providedPorts()
  {
    return {BT::InputPort<std::string>("how"), BT::OutputPort<int>("done"), BT::OutputPort<int>("late")};
  }

private:
  BT::NodeStatus onStart() override
  {
    const auto how = getInput<std::string>("how").value();
    setOutput("done", 1);
    if (how == "throw") {
      throw std::runtime_error("out of paint");
    }
    if (how == "throw a number") {
      throw 7;
    }
    if (how == "crash") {
      std::raise(SIGSEGV);
    }
    if (how == "exit") {
      std::_Exit(3);
    }
    if (how == "hang") {
      setOutput("done", 2);
      hang();
    }
    if (how[0] == '/') {  // take until there is this file
      while (access(how.c_str(), F_OK) != 0) {
        std::this_thread::sleep_for(std::chrono::milliseconds(1));
      }
      setOutput("late", 1);
    }
    return how == "idle" ? BT::NodeStatus::IDLE : BT::NodeStatus::RUNNING;
  }
  BT::NodeStatus onRunning() override { return BT::NodeStatus::RUNNING; }
  void onHalted() override
  {
    setOutput("done", 3);
    const auto how = getInput<std::string>("how").value();
    if (how == "throw in halt") {
      throw std::runtime_error("the brush sticks");
    }
    if (how == "throw a number in halt") {
      throw 7;
    }
  }
};

class HangingCondition : public BT::ConditionNode
{
public:
  using ConditionNode::ConditionNode;
  static BT::PortsList providedPorts() { return {}; }

private:
  BT::NodeStatus tick() override { hang(); }
};

class LateCondition : public BT::ConditionNode  // takes until there is a file, and writes once
{
public:
  using ConditionNode::ConditionNode;
  static BT::PortsList providedPorts() { return {BT::InputPort<std::string>("file"), BT::OutputPort<int>("late")}; }

private:
  BT::NodeStatus tick() override
  {
    if (!has_written_) {
      while (access(getInput<std::string>("file").value().c_str(), F_OK) != 0) {
        std::this_thread::sleep_for(std::chrono::milliseconds(1));
      }
      setOutput("late", 1);
      has_written_ = true;
    }
    return BT::NodeStatus::SUCCESS;
  }

  bool has_written_ = false;
};

class Wakes : public BT::StatefulActionNode  // done when another thread says so
{
public:
  using StatefulActionNode::StatefulActionNode;
  static BT::PortsList providedPorts() { return {}; }
  ~Wakes() override { join(); }

private:
  BT::NodeStatus onStart() override
  {
    is_done_ = false;
    thread_ = std::thread([this] {
      is_done_ = true;
      emitWakeUpSignal();
    });
    return BT::NodeStatus::RUNNING;
  }
  BT::NodeStatus onRunning() override
  {
    if (!is_done_) {
      return BT::NodeStatus::RUNNING;
    }
    join();
    return BT::NodeStatus::SUCCESS;
  }
  void onHalted() override { join(); }
  void join()
  {
    if (thread_.joinable()) {
      thread_.join();
    }
  }

  std::atomic_bool is_done_ = false;
  std::thread thread_;
};

class Twice : public BT::DecoratorNode
{
public:
  using DecoratorNode::DecoratorNode;
  static BT::PortsList providedPorts() { return {}; }

private:
  BT::NodeStatus tick() override { return child_node_->executeTick(); }
};

BT_REGISTER_NODES(factory)
{
  if (std::getenv("TEST_NODES_HANG") != nullptr) {
    hang();
  }
  BT::RegisterJsonDefinition<Box>();
  BT::RegisterJsonDefinition<geometry_msgs::msg::Point>();
  factory.registerScriptingEnums<Color>();
  factory.registerNodeType<Act>("Act");
  factory.registerNodeType<Sync>("Sync");
  factory.registerNodeType<Cond>("Cond");
  factory.registerNodeType<Echo<bool>>("Echo_bool");
  factory.registerNodeType<Echo<int8_t>>("Echo_int8_t");
  factory.registerNodeType<Echo<int16_t>>("Echo_int16_t");
  factory.registerNodeType<Echo<int>>("Echo_int");
  factory.registerNodeType<Echo<int64_t>>("Echo_int64_t");
  factory.registerNodeType<Echo<uint8_t>>("Echo_uint8_t");
  factory.registerNodeType<Echo<uint16_t>>("Echo_uint16_t");
  factory.registerNodeType<Echo<unsigned>>("Echo_unsigned");
  factory.registerNodeType<Echo<uint64_t>>("Echo_uint64_t");
  factory.registerNodeType<Echo<float>>("Echo_float");
  factory.registerNodeType<Echo<double>>("Echo_double");
  factory.registerNodeType<Echo<std::string>>("Echo_string");
  factory.registerNodeType<Echo<std::vector<int>>>("Echo_ints");
  factory.registerNodeType<Echo<std::vector<double>>>("Echo_doubles");
  factory.registerNodeType<Echo<std::vector<bool>>>("Echo_bools");
  factory.registerNodeType<Echo<std::vector<std::string>>>("Echo_strings");
  factory.registerNodeType<Echo<Color>>("Echo_color");
  factory.registerNodeType<Echo<Box>>("Echo_box");
  factory.registerNodeType<Echo<geometry_msgs::msg::Point>>("Echo_message");
  factory.registerNodeType<Echo<Opaque>>("Echo_opaque");
  factory.registerNodeType<Norm>("Norm");
  factory.registerNodeType<Grow>("Grow");
  factory.registerNodeType<Keep>("Keep");
  factory.registerNodeType<Add>("Add");
  factory.registerNodeType<Faulty>("Faulty");
  factory.registerNodeType<HangingCondition>("HangingCondition");
  factory.registerNodeType<LateCondition>("LateCondition");
  factory.registerNodeType<Wakes>("Wakes");
  factory.registerNodeType<Twice>("Twice");
}
