// SPDX-License-Identifier: BSD-3-Clause
// A process that runs leaves of libraries for BehaviorTree.CPP on behalf of the BT server, which starts it:
//
//     bt_plugin_host FD LIBRARY... [--ros-args ...]
//
// With --model in place of FD it prints the TreeNodesModel of the libraries instead, for tools.
//
// FD is one end of a Unix socket. The host writes one line of JSON before it loads each library, {"loading": path}, and
// then its node types, {"nodes": [...], "enums": {...}, "problems": [...]}. With each byte that it receives there comes
// the end of another socket, for the nodes of one run of a tree. The host ends when the first socket is closed.
//
// On the socket of a run, requests and answers are lines of JSON, one answer for each request, in their order:
//
//     {"node": 1, "op": "tick", "reset": true, "in": {"port": value}, "create": {"id", "name", "path", "ports"}}
//     {"node": 1, "op": "halt"}
//     {"status": "RUNNING", "out": {"port": value}}      or      {"error": text, "out": {...}}
//
// "create" comes with each tick until one did not fail; "ports" are the attributes of the XML. "in" has the ports whose
// blackboard entries changed since the last tick; null: the entry is gone. Between answers, {"wake": true} asks for a
// tick (emitWakeUpSignal). The nodes of a run are halted and destroyed when its socket is closed.

#include <ext/stdio_filebuf.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <atomic>
#include <chrono>
#include <cmath>
#include <cstring>
#include <iostream>
#include <limits>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <typeindex>
#include <unordered_map>
#include <vector>

#include "behaviortree_cpp/bt_factory.h"
#include "behaviortree_cpp/json_export.h"
#include "behaviortree_cpp/utils/shared_library.h"
#include "behaviortree_cpp/xml_parsing.h"

#ifndef BTCPP_LIBRARY_VERSION
#define BTCPP_LIBRARY_VERSION "4"
#endif

#ifdef FLEXBT_WITH_ROS
#include <rclcpp/rclcpp.hpp>

#include "behaviortree_ros2/ros_node_params.hpp"
#endif

using nlohmann::json;

namespace
{
// -- lines of JSON over a socket -------------------------------------------------------------------------------------

class Lines
{
public:
  explicit Lines(int fd) : fd_(fd), buffer_(fd, std::ios::in, 65536), in_(&buffer_) {}

  // Read a line. Return false at the end.
  bool read(std::string & line) { return static_cast<bool>(std::getline(in_, line)); }

  // Write a line, from any thread. The reader may be gone.
  void write(const json & value)
  {
    // Nodes may produce text that is not UTF-8.
    const std::string text = value.dump(-1, ' ', false, json::error_handler_t::replace) + '\n';
    const std::scoped_lock lock(mutex_);
    for (size_t sent = 0; sent < text.size();) {
      const ssize_t done = send(fd_, text.data() + sent, text.size() - sent, MSG_NOSIGNAL);
      if (done < 0 && errno == EINTR) {
        continue;
      }
      if (done < 0) {
        return;
      }
      sent += done;
    }
  }

private:
  int fd_;
  __gnu_cxx::stdio_filebuf<char> buffer_;  // closes the socket
  std::istream in_;
  std::mutex mutex_;
};

// -- types of ports, and their values --------------------------------------------------------------------------------

// Types that both sides know, by the names that BehaviorTree.CPP's users know.
const std::unordered_map<std::type_index, std::string> KNOWN_TYPES = {
  {typeid(std::string), "std::string"},
  {typeid(bool), "bool"},
  {typeid(int8_t), "int8_t"},
  {typeid(int16_t), "int16_t"},
  {typeid(int32_t), "int"},
  {typeid(int64_t), "int64_t"},
  {typeid(uint8_t), "uint8_t"},
  {typeid(uint16_t), "uint16_t"},
  {typeid(uint32_t), "unsigned int"},
  {typeid(uint64_t), "uint64_t"},
  {typeid(long long), "int64_t"},             // NOLINT: another type than int64_t
  {typeid(unsigned long long), "uint64_t"},   // NOLINT
  {typeid(float), "float"},
  {typeid(double), "double"},
  {typeid(std::vector<int>), "std::vector<int>"},
  {typeid(std::vector<double>), "std::vector<double>"},
  {typeid(std::vector<bool>), "std::vector<bool>"},
  {typeid(std::vector<std::string>), "std::vector<std::string>"},
};

bool is_known_to_json(const std::type_index & type)
{
  try {
    return BT::JsonExporter::get().fromJson(json::object(), type).has_value();
  } catch (const std::exception &) {
    return true;  // there is a converter, which needs fields
  }
}

// Return whether convertFromString is specialized for the type of a port: else its generic form throws.
bool is_readable_from_text(const BT::PortInfo & port)
{
  std::streambuf * const buffer = std::cerr.rdbuf(nullptr);  // on which it complains, too
  bool is_readable = true;
  try {
    (void)port.converter()("");
  } catch (const BT::LogicError & error) {
    is_readable = std::string(error.what()).find("template specialization") == std::string::npos;
  } catch (...) {
    // The text is wrong for the type.
  }
  std::cerr.rdbuf(buffer);
  return is_readable;
}

// Return how the values of a port cross: "known", "any", "json", "text"; or "none".
std::string form_of(const BT::PortInfo & port)
{
  if (KNOWN_TYPES.count(port.type()) != 0) {
    return "known";
  }
  if (!port.isStronglyTyped() || !port.converter()) {
    return "any";  // an enumeration has no converter: it crosses as its number, or its name
  }
  if (is_known_to_json(port.type())) {
    return "json";
  }
  return port.direction() == BT::PortDirection::INPUT && is_readable_from_text(port) ? "text" : "none";
}

json description_of(const BT::TreeNodeManifest & manifest)
{
  json node = {{"id", manifest.registration_ID}, {"kind", BT::toStr(manifest.type)}, {"ports", json::array()}};
  std::string text;
  for (const auto & [key, value] : manifest.metadata) {
    text += (text.empty() ? "" : "\n\n") + (key == "description" ? value : key + ": " + value);
  }
  node["description"] = text;
  const std::map<std::string, BT::PortInfo> sorted(manifest.ports.begin(), manifest.ports.end());
  for (const auto & [name, port] : sorted) {
    const auto known = KNOWN_TYPES.find(port.type());
    json one = {
      {"name", name},
      {"direction", BT::toStr(port.direction())},
      {"type", known != KNOWN_TYPES.end() ? known->second : BT::demangle(port.type())},
      {"form", form_of(port)},
      {"description", port.description()}};
    if (!port.defaultValueString().empty()) {
      one["default"] = port.defaultValueString();
    }
    node["ports"].push_back(one);
  }
  return node;
}

// Numbers that JSON lacks have their names of YAML in lists and objects, as in the texts of messages.
const std::map<std::string, double> NAMED_NUMBERS = {
  {".nan", std::numeric_limits<double>::quiet_NaN()},
  {".inf", std::numeric_limits<double>::infinity()},
  {"-.inf", -std::numeric_limits<double>::infinity()},
};

void name_numbers(json & value)
{
  if (value.is_number_float() && !std::isfinite(value.get<double>())) {
    const auto number = value.get<double>();
    value = std::isnan(number) ? ".nan" : number > 0 ? ".inf" : "-.inf";
  } else if (value.is_structured()) {
    for (auto & part : value) {
      name_numbers(part);
    }
  }
}

void read_numbers(json & value)
{
  const auto named = value.is_string() ? NAMED_NUMBERS.find(value.get<std::string>()) : NAMED_NUMBERS.end();
  if (named != NAMED_NUMBERS.end()) {
    value = named->second;
  } else if (value.is_structured()) {
    for (auto & part : value) {
      read_numbers(part);
    }
  }
}

BT::Any value_of(const json & value, const BT::PortInfo & port)
{
  const auto & exporter = BT::JsonExporter::get();
  if (value.is_null()) {
    return {};
  }
  if (value.is_string()) {
    const auto text = value.get<std::string>();
    if (port.direction() == BT::PortDirection::INOUT && port.converter()) {
      try {
        return port.converter()(text);  // the node may write a value of its type over it
      } catch (const std::exception &) {
        // As in BehaviorTree.CPP, it fails when the node reads it.
      }
    }
    return BT::Any(text);
  }
  if (value.is_boolean()) {
    return BT::Any(value.get<bool>());
  }
  if (value.is_number_unsigned() && value.get<uint64_t>() > uint64_t(std::numeric_limits<int64_t>::max())) {
    return BT::Any(value.get<uint64_t>());
  }
  if (value.is_number_integer()) {
    return BT::Any(value.get<int64_t>());
  }
  if (value.is_number_float()) {
    return BT::Any(value.get<double>());
  }
  if (port.type() == typeid(std::vector<std::string>)) {
    return BT::Any(value.get<std::vector<std::string>>());
  }
  json read = value;
  read_numbers(read);
  if (port.type() == typeid(std::vector<double>)) {
    return BT::Any(read.get<std::vector<double>>());
  }
  if (port.type() == typeid(std::vector<int>)) {
    return BT::Any(value.get<std::vector<int>>());
  }
  if (port.type() == typeid(std::vector<bool>)) {
    return BT::Any(value.get<std::vector<bool>>());
  }
  auto entry = port.isStronglyTyped() ? exporter.fromJson(read, port.type()) : exporter.fromJson(read);
  if (!entry) {
    throw BT::RuntimeError("a value of type ", BT::demangle(port.type()), " cannot be read: ", entry.error());
  }
  return entry->first;
}

json json_of(const BT::Any & value)
{
  if (value.type() == typeid(bool)) {
    return value.cast<bool>();
  }
  if (value.castedType() == typeid(double) && !std::isfinite(value.cast<double>())) {
    return std::to_string(value.cast<double>());  // JSON has no such numbers
  }
  json result;
  if (!BT::JsonExporter::get().toJson(value, result)) {
    throw BT::RuntimeError(
      "a value of type ", BT::demangle(value.type()), " cannot leave the host: register it with "
      "BT::RegisterJsonDefinition");
  }
  name_numbers(result);
  if (result.is_object()) {
    result["__type"] = BT::demangle(value.type());
  }
  return result;
}

// -- the nodes of a run ----------------------------------------------------------------------------------------------

// Access to what only trees and parents may call.
struct Parent : BT::TreeNode
{
  static void reset(BT::TreeNode & node) { (node.*(&Parent::resetStatus))(); }
  static void set_wake_up(BT::TreeNode & node, std::shared_ptr<BT::WakeUpSignal> signal)
  {
    (node.*(&Parent::setWakeUpInstance))(std::move(signal));
  }
};

class HostedNode
{
public:
  HostedNode(
    const BT::BehaviorTreeFactory & factory, const json & given, const std::shared_ptr<BT::WakeUpSignal> & signal,
    const BT::Blackboard & common)
  : manifest_(factory.manifests().at(given.at("id").get<std::string>())), board_(BT::Blackboard::create())
  {
    common.cloneInto(*board_);
    BT::NodeConfig config;
    config.blackboard = board_;
    config.manifest = &manifest_;
    config.path = given.at("path").get<std::string>();
    config.uid = given.at("uid").get<uint16_t>();
    for (const auto & [name, text] : given.at("ports").items()) {
      const auto & port = manifest_.ports.at(name);
      const auto written = text.get<std::string>();
      if (port.direction() != BT::PortDirection::OUTPUT) {
        config.input_ports[name] = written;
      }
      if (port.direction() != BT::PortDirection::INPUT) {
        config.output_ports[name] = written;
      }
      if (const auto key = BT::TreeNode::getRemappedKey(name, written)) {
        keys_[name] = std::string(*key);
        if (board_->getEntry(keys_[name]) == nullptr) {
          board_->createEntry(keys_[name], port);
        }
      }
    }
    node_ = factory.instantiateTreeNode(given.at("name").get<std::string>(), manifest_.registration_ID, config);
    Parent::set_wake_up(*node_, signal);
  }

  ~HostedNode()
  {
    try {
      halt();
    } catch (const std::exception & error) {
      std::cerr << "[" << node_->fullPath() << "] raised when its run ended: " << error.what() << std::endl;
    } catch (...) {
      std::cerr << "[" << node_->fullPath() << "] raised when its run ended" << std::endl;
    }
  }
  HostedNode(const HostedNode &) = delete;
  HostedNode & operator=(const HostedNode &) = delete;

  void read(const json & inputs)
  {
    for (const auto & [name, value] : inputs.items()) {
      const auto & port = manifest_.ports.at(name);
      const auto entry = board_->getEntry(keys_.at(name));
      BT::Any received;
      try {
        received = value_of(value, port);
      } catch (const std::exception & error) {
        throw BT::RuntimeError("port [", name, "]: ", error.what());
      }
      const std::scoped_lock lock(entry->entry_mutex);
      entry->value = std::move(received);
      entry->sequence_id++;
      entry->stamp = std::chrono::steady_clock::now().time_since_epoch();
      auto & [sequence, before] = known_[keys_.at(name)];
      sequence = entry->sequence_id;
      if (port.direction() == BT::PortDirection::INOUT) {
        before = entry->value.empty() ? json() : json_of(entry->value);
      }
    }
  }

  BT::NodeStatus tick(bool is_reset)
  {
    if (is_reset) {
      Parent::reset(*node_);
    }
    return node_->executeTick();
  }

  void halt()
  {
    if (node_->status() == BT::NodeStatus::RUNNING) {
      node_->haltNode();
    }
    Parent::reset(*node_);
  }

  // Return what the node has written since the last time, by port.
  json outputs()
  {
    json written = json::object();
    for (const auto & [name, key] : keys_) {
      const auto direction = manifest_.ports.at(name).direction();
      const auto entry = board_->getEntry(key);
      if (direction == BT::PortDirection::INPUT || entry == nullptr) {
        continue;
      }
      const std::scoped_lock lock(entry->entry_mutex);
      auto & [sequence, before] = known_[key];
      const bool is_new = entry->sequence_id != sequence;
      if (entry->value.empty() || (!is_new && direction == BT::PortDirection::OUTPUT)) {
        continue;
      }
      json now;
      try {
        now = json_of(entry->value);
      } catch (const std::exception & error) {
        throw BT::RuntimeError("port [", name, "]: ", error.what());
      }
      if (is_new || now != before) {  // getLockedPortContent changes a value in place
        written[name] = now;
      }
      sequence = entry->sequence_id;
      before = std::move(now);
    }
    return written;
  }

private:
  const BT::TreeNodeManifest & manifest_;
  BT::Blackboard::Ptr board_;
  std::map<std::string, std::string> keys_;
  std::map<std::string, std::pair<uint64_t, json>> known_;  // what the server has, by key
  std::unique_ptr<BT::TreeNode> node_;
};

// Serve the nodes of one run, in the order of the requests, until its socket is closed.
void serve(const BT::BehaviorTreeFactory & factory, const BT::Blackboard & common, int fd)
{
  Lines lines(fd);
  const auto signal = std::make_shared<BT::WakeUpSignal>();
  std::atomic_bool is_open = true;
  std::thread waker([&] {
    while (is_open) {
      // A signal that is sent just before the wait is lost: look again.
      if (signal->waitFor(std::chrono::seconds(1)) && is_open) {
        lines.write({{"wake", true}});
      }
    }
  });
  {
    std::map<int, std::unique_ptr<HostedNode>> nodes;
    for (std::string line; lines.read(line);) {
      json answer = {{"out", json::object()}};
      try {
        const json request = json::parse(line);
        auto & node = nodes[request.at("node").get<int>()];
        try {
          if (node == nullptr) {
            node = std::make_unique<HostedNode>(factory, request.at("create"), signal, common);
          }
          if (request.at("op") == "halt") {
            node->halt();
            answer["status"] = "IDLE";
          } else {
            node->read(request.at("in"));
            answer["status"] = BT::toStr(node->tick(request.at("reset").get<bool>()));
          }
        } catch (const std::exception & error) {
          answer["error"] = error.what();
        }
        if (node != nullptr) {
          answer["out"] = node->outputs();
        }
      } catch (const std::exception & error) {
        answer["error"] = error.what();
      } catch (...) {
        answer["error"] = "the node threw something that is not a std::exception";
      }
      lines.write(answer);
    }
  }
  is_open = false;
  signal->emitSignal();
  waker.join();
}

// -- libraries -------------------------------------------------------------------------------------------------------

void load(const std::string & path, BT::BehaviorTreeFactory & factory, void * ros_params)
{
  BT::SharedLibrary library;
  try {
    library.load(path);
  } catch (const std::exception & error) {
    throw BT::RuntimeError(
      error.what(), "; this host was built with BehaviorTree.CPP " BTCPP_LIBRARY_VERSION ", and the library has to be, too");
  }
  bool is_plugin = library.hasSymbol(BT::PLUGIN_SYMBOL);
  if (is_plugin) {
    factory.registerFromPlugin(path);
  }
  if (library.hasSymbol("BT_RegisterRosNodeFromPlugin")) {
#ifdef FLEXBT_WITH_ROS
    using Register = void (*)(BT::BehaviorTreeFactory &, const BT::RosNodeParams &);
    auto * const add = reinterpret_cast<Register>(library.getSymbol("BT_RegisterRosNodeFromPlugin"));
    add(factory, *static_cast<const BT::RosNodeParams *>(ros_params));
    is_plugin = true;
#else
    (void)ros_params;
    throw BT::RuntimeError(
      path, " has ROS nodes (BT_REGISTER_ROS_NODES), and this host was built without rclcpp or behaviortree_ros2");
#endif
  }
  if (!is_plugin) {
    throw BT::RuntimeError(
      path, " registers no nodes: it needs BT_REGISTER_NODES, and the compile definition BT_PLUGIN_EXPORT");
  }
}

// Receive the socket of a run; -1 when the server has closed its end.
int receive_socket(int control)
{
  char byte = 0;
  iovec data = {&byte, 1};
  alignas(cmsghdr) char space[CMSG_SPACE(sizeof(int))];
  msghdr message = {};
  message.msg_iov = &data;
  message.msg_iovlen = 1;
  message.msg_control = space;
  message.msg_controllen = sizeof(space);
  ssize_t got = 0;
  do {
    got = recvmsg(control, &message, MSG_CMSG_CLOEXEC);
  } while (got < 0 && errno == EINTR);
  const cmsghdr * const header = got > 0 ? CMSG_FIRSTHDR(&message) : nullptr;
  if (header == nullptr || header->cmsg_type != SCM_RIGHTS) {
    return -1;
  }
  int fd = -1;
  std::memcpy(&fd, CMSG_DATA(header), sizeof(fd));
  return fd;
}
}  // namespace

int main(int argc, char ** argv)
{
  if (argc < 3) {
    std::cerr << "bt_plugin_host is started by bt_server: see its parameter 'plugins'\n"
                 "usage for a model of libraries: bt_plugin_host --model LIBRARY..."
              << std::endl;
    return 2;
  }
  const bool is_for_model = std::strcmp(argv[1], "--model") == 0;
  const int control = is_for_model ? -1 : std::atoi(argv[1]);
  if (!is_for_model) {
    // When the server has ended, end too, half a second later: by then nodes that return are destroyed.
    std::thread([control] {
      pollfd end = {control, POLLRDHUP, 0};
      while (poll(&end, 1, -1) < 0) {
      }
      std::this_thread::sleep_for(std::chrono::milliseconds(500));
      std::_Exit(0);
    }).detach();
  }
  BT::BehaviorTreeFactory factory;
  // Keys that nodes of Nav2 read, whatever their ports.
  const auto common = BT::Blackboard::create();
  void * ros_params = nullptr;
#ifdef FLEXBT_WITH_ROS
  rclcpp::init(argc, argv, rclcpp::InitOptions(), rclcpp::SignalHandlerOptions::None);
  const auto node = std::make_shared<rclcpp::Node>("bt_plugin_host_" + std::to_string(getpid()));
  BT::RosNodeParams params;
  params.nh = node;
  ros_params = &params;
  common->set<rclcpp::Node::SharedPtr>("node", node);
  common->set<std::chrono::milliseconds>("bt_loop_duration", std::chrono::milliseconds(10));
  common->set<std::chrono::milliseconds>("server_timeout", std::chrono::milliseconds(1000));
  common->set<std::chrono::milliseconds>("wait_for_service_timeout", std::chrono::milliseconds(1000));
  std::thread([node] { rclcpp::spin(node); }).detach();
#endif
  json report = {{"nodes", json::array()}, {"enums", json::object()}, {"problems", json::array()}};
  // The main thread alone writes to this socket, and only until the node types are complete.
  static Lines lines(dup(control));
  for (int place = 2; place < argc && std::strcmp(argv[place], "--ros-args") != 0; ++place) {
    lines.write({{"loading", argv[place]}});
    try {
      load(argv[place], factory, ros_params);
    } catch (const std::exception & error) {
      report["problems"].push_back(error.what());
    }
  }
  if (is_for_model) {
    for (const auto & problem : report["problems"]) {
      std::cerr << problem.get<std::string>() << std::endl;
    }
    std::cout << BT::writeTreeNodesModelXML(factory) << std::flush;
    std::_Exit(report["problems"].empty() ? 0 : 1);
  }
  for (const auto & [id, manifest] : factory.manifests()) {
    if (factory.builtinNodes().count(id) == 0) {
      report["nodes"].push_back(description_of(manifest));
    }
  }
  const std::unique_ptr<const BT::TreeNode> any = factory.instantiateTreeNode("", "AlwaysSuccess", {});
  for (const auto & [name, value] : *any->config().enums) {
    report["enums"][name] = value;
  }
  lines.write(report);
  static std::atomic_int runs = 0;
  for (int fd = receive_socket(control); fd >= 0; fd = receive_socket(control)) {
    ++runs;
    std::thread([&factory, &common, fd] {
      serve(factory, *common, fd);
      --runs;
    }).detach();
  }
  while (runs > 0) {  // the server closes their sockets, too
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  std::_Exit(0);
}
