// SPDX-License-Identifier: BSD-3-Clause
// Starts flexbt-ls for trees, machines and behaviors.
const {workspace, window} = require('vscode');
const {LanguageClient} = require('vscode-languageclient/node');

let client;

exports.activate = async () => {
  const settings = workspace.getConfiguration('flexbt'), command = settings.get('languageServer');
  client = new LanguageClient('flexbt', 'FlexBT', {command}, {
    initializationOptions: {runPython: settings.get('runPython')},
    documentSelector: ['xml', 'yaml', 'python'].map((language) => ({scheme: 'file', language})),
  });
  try {
    await client.start();
  } catch (error) {
    window.showErrorMessage(`${command} could not be started: ${error.message}. Source your ROS 2 workspace and start `
      + 'the editor from that shell, or set flexbt.languageServer.');
  }
};

exports.deactivate = () => client?.stop();
